"""Writes a fitted law as an effect of its own, in a plugin folder: a module and the robot that has it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from textwrap import wrap

from exodrake.core.effect import Effect
from exodrake.core.files import write_text
from exodrake.core.robot import Robot
from exodrake.diagnosis.discovery.candidate import CandidateLaw
from exodrake.diagnosis.discovery.effect_text import (
    ELEMENTS,
    HEADER,
    KNOTS,
    WEIGHTS,
    effect_source,
    law_source,
)  # fmt: skip
from exodrake.diagnosis.discovery.forms import CURVE, HYSTERESIS, PLACE, LawPoint
from exodrake.diagnosis.discovery.law_machine import MachineMap, module_of
from exodrake.machines.write_robot import robot_text

SWITCH = "present"
USED = ("curve", "dragged", "faded", "inside", "slope", "stop_operator")
NOTE = (
    "A free law that `exodrake diagnose` found: present = 1 puts it in, 0 is the robot without it. The values here are "
    "those of the strongest channel; those of each one are in the robot file beside this folder."
)
KNOTS_ARE = {
    CURVE: "k1 .. k8 are knots [{unit}] and w1 .. w8 the values of the curve there.",
    PLACE: "k1 .. k8 are knots [{unit}] and w1 .. w8 the values of the curve there.",
    HYSTERESIS: "k1 .. k8 are reaches [{unit}] of stop operators and w1 .. w8 their weights.",
}
FADING = "k1 .. k8 are time constants [s] of Maxwell elements and w1 .. w8 their weights."


def single(law: LawPoint, number: int) -> LawPoint:
    """The point with one of its forms alone."""
    return replace(law, identity=law.learned, forms=(law.forms[number - 1],))


def effect_text(candidate: CandidateLaw, weights, case: str, formulas: dict[str, str]) -> str:
    """Source of the effect's module.

    Args:
        candidate: the law.
        weights: (channels, 8) fitted [unit of the law].
        case: name of the case it was fitted to.
        formulas: channel -> plain formula, if there is one.
    """
    law, form = single(candidate.law, candidate.number), candidate.form
    strongest = int(abs(weights).max(axis=1).argmax())
    axis, several = law.point.axis, 'null=k, low=-1e9, high=1e9, axis="{}", default=k, fitted=False'
    spread = '*(EffectParameter(f"{}{{i}}", "{}", ' + several.format(axis) + ") for i, k in enumerate({}, 1))"
    parameters = [
        f'EffectParameter("{SWITCH}", "-", null=0.0, low=0.0, high=1.0, axis="{axis}", default=1.0, fitted=False)',
        spread.format("k", form.unit or "-", "AT"),
        spread.format("w", "-", "VALUES"),
    ]
    values = {"AT": candidate.knots[strongest], "VALUES": weights[strongest]}
    constants = [f"{name} = ({', '.join(f'{v:.6g}' for v in row)})" for name, row in values.items()]
    body = law_source(law, SWITCH)
    used = ", ".join(n for n in USED if f"{n}(" in body)
    header = HEADER.format(summary=summary(candidate, case, formulas)).replace(", ".join(USED), used)
    if ELEMENTS[0] not in body:
        header = header.replace("from exodrake.core.part import State\n", "")
    effect = effect_source(law, "EFFECT", f"{form.words}, found in logs", parameters, f"fitted to {case}")
    return "\n\n\n".join([header.rstrip() + "\n\n" + "\n".join(constants), body, effect]) + "\n"


def summary(candidate: CandidateLaw, case: str, formulas: dict[str, str]) -> str:
    """The docstring of the effect's module: what it is, its equation and formulas."""
    form, value = candidate.form, candidate.law.arguments[0]
    law = f"law = {form.factor + ' ' if form.factor else ''}f(u)      u = {form.variable}"
    knots = KNOTS_ARE.get(form.kind, FADING).format(unit=form.unit)
    lines = [f"{form.words[0].upper()}{form.words[1:]}, found in the logs of {case}.", ""]
    lines += [f"{value} -> {form.result or f'{value} + law'}      {law}"]
    lines += [f"{channel or 'here'}: {text}" for channel, text in formulas.items()]
    return "\n".join([*lines, "", *wrap(f"{NOTE} {knots}", 110)]) + "\n"


def robot_with(robot: Robot, candidate: CandidateLaw, weights, text: str) -> Robot:
    """A robot of the plain machine with the effect of a module's text in it, each channel with its own values."""
    machine = robot.machine
    module = module_of(text, f"found_{machine.name}")
    effect = next(value for value in vars(module).values() if isinstance(value, Effect))
    out = MachineMap(machine, replace(machine, effects=(*machine.effects, effect))).robot(robot)
    on = [c for c, w in zip(candidate.channels, weights, strict=True) if w.any()]
    given = {SWITCH: dict.fromkeys(on, 1.0)}
    for i, (k, w) in enumerate(zip(KNOTS, WEIGHTS, strict=True)):
        given[k] = dict(zip(candidate.channels, map(float, candidate.knots[:, i]), strict=True))
        given[w] = dict(zip(candidate.channels, map(float, weights[:, i]), strict=True))
    return out.splice(effect.id, given, on)


def write_law(folder: Path, identity: str, text: str, robot: Robot, case: str) -> list[Path]:
    """Writes a plugin folder: `effects/NAME.py` and `robot.yaml`."""
    module = folder / "effects" / f"{identity.replace('.', '_')}.py"
    module.parent.mkdir(parents=True, exist_ok=True)
    write_text(module, text)
    write_text(folder / "robot.yaml", robot_text(robot, f"with a law found in {case} by exodrake diagnose"))
    return [module, folder / "robot.yaml"]
