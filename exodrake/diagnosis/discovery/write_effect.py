"""Writes a fitted law as an effect of its own, in a plugin folder: a module and the robot that has it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from exodrake.core.effect import Effect
from exodrake.core.files import write_text
from exodrake.core.robot import Robot
from exodrake.diagnosis.discovery.candidate import Candidate
from exodrake.diagnosis.discovery.effect_text import (
    ELEMENTS,
    HEADER,
    KNOTS,
    WEIGHTS,
    effect_source,
    law_source,
    parameter_source,
)  # fmt: skip
from exodrake.diagnosis.discovery.forms import CURVE, HYSTERESIS, PLACE, LawPoint
from exodrake.diagnosis.discovery.law_machine import Moved, module_of
from exodrake.machines.robot_file import robot_text

SWITCH = "present"
USED = ("curve", "dragged", "faded", "inside", "slope", "stopped")
NOTE = """

A free law that `exodrake diagnose` found in the logs of {case}. {knots}
present = 1 puts it in, 0 is the robot without it; values of each channel are in the robot file beside this folder."""
KNOTS_ARE = {
    CURVE: "k1 .. k8 are knots [{unit}] and w1 .. w8 the values of the curve there.",
    PLACE: "k1 .. k8 are knots [{unit}] and w1 .. w8 the values of the curve there.",
    HYSTERESIS: "k1 .. k8 are reaches [{unit}] of stop operators and w1 .. w8 their weights.",
}
FADING = "k1 .. k8 are time constants [s] of Maxwell elements and w1 .. w8 their weights."


def single(law: LawPoint, number: int) -> LawPoint:
    """The point with one of its forms alone."""
    return replace(law, identity=law.learned, forms=(law.forms[number - 1],))


def effect_text(candidate: Candidate, weights, case: str, formulas: dict[str, str]) -> str:
    """Source of the effect's module.

    Args:
        candidate: the law.
        weights: (channels, 8) fitted [unit of the law].
        case: name of the case it was fitted to.
        formulas: channel -> plain formula, if there is one.
    """
    law, form = single(candidate.law, candidate.number), candidate.form
    strongest = int(abs(weights).max(axis=1).argmax())
    pairs = [(n, "-", candidate.knots[strongest, i]) for i, n in enumerate(KNOTS)]
    pairs += [(n, "-", weights[strongest, i]) for i, n in enumerate(WEIGHTS)]
    parameters = [parameter_source(SWITCH, law.point, "-", 0.0, 1.0)]
    parameters += [
        parameter_source(n, law.point, unit, float(i), float(value)) for i, (n, unit, value) in enumerate(pairs)
    ]
    name = law.arguments[0]
    acts = form.result or f"{name} + law"
    lines = [f"{form.words[0].upper()}{form.words[1:]}, found in the logs of {case}.", ""]
    lines += [f"{name} -> {acts}      law = {form.factor + ' ' if form.factor else ''}f(u)      u = {form.variable}"]
    lines += [*(f"{channel or 'all'}: {text}" for channel, text in formulas.items())]
    knots = KNOTS_ARE.get(form.kind, FADING).format(unit=form.unit)
    doc = "\n".join(lines) + NOTE.format(case=case, knots=knots) + "\n"
    body = law_source(law, SWITCH)
    used = ", ".join(n for n in USED if f"{n}(" in body)
    header = HEADER.format(summary=doc).replace(", ".join(USED), used)
    if not any(e in body for e in ELEMENTS[:1]):
        header = header.replace("from exodrake.core.part import State\n", "")
    effect = effect_source(law, "EFFECT", f"{form.words}, found in logs", parameters, f"fitted to {case}")
    return "\n\n\n".join([header.rstrip() + "\n", body, effect]).replace("\n\n\n\n", "\n\n\n") + "\n"


def robot_with(robot: Robot, candidate: Candidate, weights, text: str) -> Robot:
    """A robot of the plain machine with the effect of a module's text in it, each channel with its own values."""
    machine = robot.machine
    module = module_of(text, f"found_{machine.name}")
    effect = next(value for value in vars(module).values() if isinstance(value, Effect))
    out = Moved(machine, replace(machine, effects=(*machine.effects, effect))).robot(robot)
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
