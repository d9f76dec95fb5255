"""Free laws as source code: effects at the points of a machine, and watches that record the ranges of their variables.

A law is an effect whose first parameter picks its form; knots k1 .. k8 and weights w1 .. w8 of each channel give its
shape. The same text serves the search (all points of a machine) and the fitted law, a module of its own.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from textwrap import wrap

import numpy as np

from exodrake.core.files import write_folder
from exodrake.engine.cache import cache_folder, once, write_if_different
from exodrake.machines.robot_file import robot_text
from exodrake.model.effect import Effect
from exodrake.model.machine import Machine
from exodrake.model.part import (
    HYSTERESIS,
    PLACE,
    RELAXATION,
    FreeLaw,
    Point,
    free_memory,
    module_of_file,
    point_arguments,
    point_key,
)  # fmt: skip
from exodrake.model.robot import Robot

SIZE = 8  # knots of a curve, or elements of a memory
BINS = 12  # in which a watch counts
KNOTS = tuple(f"k{i + 1}" for i in range(SIZE))
WEIGHTS = tuple(f"w{i + 1}" for i in range(SIZE))
ELEMENTS = (*(f"s{i + 1}" for i in range(SIZE)), "last", "started")
COUNTS = tuple(f"c{i + 1}" for i in range(BINS))
SEEN = ("low_seen", "high_seen", *COUNTS, "place", "started")
WATCHED = ("low", "high")  # range in which a watch counts
PLAIN = ("dt", "held", "arrival", "period", "mobility", "bones", "history")  # arguments that no law depends on
FUNCTIONS = ("curve", "inside", "lose_speed", "maxwell_element", "slope", "stop_operator")  # of `effects.law_table`
HEADER = '''"""{summary}"""

from exodrake.model.effect import Effect, EffectParameter
from exodrake.model.part import State
from exodrake.effects.law_table import {functions}
'''
DEFINITION = """{name} = Effect(
    id="{identity}",
    summary={summary!r},
    signature="none of its own",
    source={source!r},
    at={{{at}}},
    parameters=(
        {parameters},
    ),
{more}    family="law",
    not_tried="a free law, which `--discover` tries",
)"""
BRAKED = "lose_speed(speed, law * mobility)"  # dry friction never turns a stop into a push
VALUE = "{value}"  # the point's own value, whose name differs between parts
# of the points that are standard ones (`Point.standard`): forces and losses of what slides, and readings
STANDARD = {
    "sliding.pushed": (
        FreeLaw("force over speed", "speed", "m/s", "-1.0", fine=True),
        FreeLaw("force over place", "travel", "m", "-1.0", PLACE, "settle", moves=True),
        FreeLaw("gain over place", "travel", "m", VALUE, PLACE, "settle", moves=True),
        *free_memory("of force over place", "travel", "m", "settle", "-1.0", moves=True),
    ),
    "sliding.braked": (
        FreeLaw("dry friction over speed", "abs(speed)", "m/s", fine=True, result=BRAKED),
        FreeLaw("dry friction over load", "load", "N", result=BRAKED),
        FreeLaw("dry friction over place", "travel", "m", "", PLACE, "settle", moves=True, result=BRAKED),
    ),
    "sliding.settle": (),
    "signal.shown": (
        FreeLaw("error of the reading over its value", "value", ""),
        FreeLaw("error of the reading over time", "clock", "s"),
        *free_memory("of the reading", "value", "", "shown"),
    ),
    "signal.mixed": (),
    "signal.delivered": (),
}
SWITCH = "present"  # of the fitted law; that of a search is `form`
NOTE = (
    "A free law that `exodrake diagnose` found: present = 1 puts it in, 0 is the robot without it. The values here are "
    "those of the strongest channel; those of each one are in the robot file beside this folder."
)
SHAPES = {
    HYSTERESIS: "k1 .. k8 are reaches [{unit}] of stop operators and w1 .. w8 their weights.",
    RELAXATION: "k1 .. k8 are time constants [s] of Maxwell elements and w1 .. w8 their weights.",
}
CURVES = "k1 .. k8 are knots [{unit}] and w1 .. w8 the values of the curve there."


@dataclass(frozen=True)
class LawPoint:
    """A point of a machine with the free laws that may be missing there."""

    key: str  # "module.point"
    identity: str  # id of the free law while it is searched
    point: Point
    arguments: dict[str, tuple[str, ...]]  # of points, the law's own and those that advance states or take a rate
    forms: tuple[FreeLaw, ...]  # the laws
    scale: str  # source of what is as large as the law may be

    @property
    def learned(self) -> str:
        """Id of the effect that the fitted law becomes."""
        return self.identity.replace(".law_", ".learned_")

    @property
    def block(self) -> str:
        """Block of the robot that it acts in."""
        return self.identity.split(".")[0]


def law_points(machine: Machine) -> list[LawPoint]:
    """Points of a machine where a law may be missing, one for each id."""
    found: dict[str, LawPoint] = {}
    for part in machine.parts:
        arguments = {point.name: point_arguments(part, point) for point in part.points}
        for point in part.points:
            own = arguments[point.name]
            laws = STANDARD.get(point.standard) if point.laws is None else point.laws
            if laws is None:
                laws = tuple(FreeLaw(f"{own[0]} over {name}", name, "") for name in own if name not in PLAIN)
            if laws:
                key = point_key(part, point)
                blocks = [effect.block for effect in machine.effects if key in effect.at] or [part.name]
                identity = f"{max(blocks, key=blocks.count)}.law_{point.name}"
                forms = tuple(replace(f, factor=f.factor.replace(VALUE, own[0])) for f in laws)
                scale = "load" if point.standard == "sliding.braked" else own[0]
                found[identity] = LawPoint(key, identity, point, arguments, forms, scale)
    return list(found.values())


def write_effect(
    law: LawPoint, name: str, summary: str, parameters: Sequence[str], source: str, watch: bool = False,
    switch: str = "form",
) -> str:  # fmt: skip
    """Source of the effect of a law: its functions at all its points, and its definition; `parameters`: source of each.

    Its first parameter, `switch`, is the number of a form. A watch keeps range and counts of the variable of a form
    instead, and of the law's scale for one number more.
    """
    own, value = law.point.name, law.arguments[law.point.name][0]
    advances = dict.fromkeys(f.advances for f in law.forms if f.advances)  # points at which states of a form advance
    elsewhere = [point for point in advances if point != own]
    known, kept = (WATCHED, SEEN) if watch else ((*KNOTS, *WEIGHTS), ELEMENTS if advances else ())
    filters = watch or own in advances
    states = ", ".join(kept)
    # of each point: bodies by form, and what it returns without one
    cases: dict[str, dict[int, list[str]]] = {point: {} for point in (own, *elsewhere)}
    ends = dict.fromkeys(elsewhere, states) | {own: f"{value}, {states}" if filters else value}
    if watch:
        count = [f"{c} + inside(u, low, high, {i}.0, {BINS}.0)" for i, c in enumerate(COUNTS)]
        low, high = (f"u if started == 0.0 else {f}({end}, u)" for f, end in zip(("min", "max"), SEEN))
        seen = ", ".join([low, high, *count, "u", "1.0"])
        variables = [(f.advances or own, f.variable, f.moves and f.advances != own) for f in law.forms]
        for k, (point, variable, moves) in enumerate([*variables, (own, law.scale, False)], 1):
            result = f"{value}, {seen}" if point == own else seen
            cases[point][k] = [f"u = {'place + ' if moves else ''}{variable}", f"return {result}"]
    else:
        for k, f in enumerate(law.forms, 1):
            here = f.advances == own
            if f.is_curve:
                total = f"curve({'s1' if f.kind == PLACE else f.variable}, {', '.join(known)})"
            else:
                divided = " / {k}" if f.kind == HYSTERESIS else ""
                total = f"({' + '.join(fill_elements('{w} * {s}' + divided))})"
            result = f"return {f.result or f'{value} + law'}{f', {states}' if filters else ''}"
            change: list[str] = []  # lines that advance the elements by the move of the variable
            if f.advances:
                step = {
                    PLACE: "{s} = {s} + change",
                    HYSTERESIS: "{s} = stop_operator({s}, change, {k})",
                    RELAXATION: f"{{s}} = maxwell_element({{s}}, change, {'period' if here else 'dt'}, {{k}})",
                }[f.kind]
                move = f.variable if f.moves else f"{f.variable} - last if started > 0.0 else 0.0"
                last = "0.0" if f.moves else f.variable
                change = [f"change = {move}", *fill_elements(step), f"last, started = {last}, 1.0"]
            cases[own][k] = [*(change if here else []), f"law = {f'{f.factor} * ' if f.factor else ''}{total}", result]
            if change and not here:
                cases[f.advances][k] = [*change, f"return {states}"]
            if f.rate[0]:
                point, variable, result = f.rate
                called = result.replace("slope", f"slope({variable}, {', '.join(known)})")
                cases.setdefault(point, {})[k] = [f"return {called}"]
                ends.setdefault(point, law.arguments[point][0])
    found, at, module = [], [], law.key.split(".")[0]
    for point, bodies in cases.items():
        full = "__".join((module, own, *([point] if point != own else []), *(["watch"] if watch else [])))
        lines = [f"def {full}({', '.join((*law.arguments[point], switch, *known, *kept))}):"]
        lines.append('    """Effect of the law, by its form."""')
        for k, body in bodies.items():
            lines += [f"    if {switch} == {k}.0:", *(f"        {line}" for line in body)]
        found.append("\n".join([*lines, f"    return {ends[point]}"]))
        at.append(f'"{module}.{point}": {full}')
    axis = law.point.axis
    more = [f"states=({', '.join(f'State("{s}", "{axis}")' for s in kept)},)"] if kept else []
    more += [f"advances={tuple(f'{module}.{a}' for a in elsewhere)!r}"] if elsewhere else []
    more += [f"filters={(law.key,)!r}"] if filters else []
    definition = DEFINITION.format(
        name=name, identity=f"{law.identity}_watch" if watch else law.identity, summary=summary, source=source,
        at=", ".join(at), parameters=",\n        ".join(parameters), more="".join(f"    {line},\n" for line in more),
    )  # fmt: skip
    return "\n\n\n".join([*found, definition])


def fill_elements(text: str) -> list[str]:
    """A text for each element of a law with memory: {s} its state, {k} its knot, {w} its weight."""
    return [text.format(s=s, k=k, w=w) for s, k, w in zip(ELEMENTS[:SIZE], KNOTS, WEIGHTS, strict=True)]


def module_text(machine: Machine) -> str:
    """Source of all laws and watches of a machine."""
    summary = f"Free laws at the points of {machine.name}, made by exodrake."
    pieces = [HEADER.format(summary=summary, functions=", ".join(FUNCTIONS))]
    nulls = {n: float(i) for i, n in enumerate(KNOTS)} | dict.fromkeys(WEIGHTS, 0.0)
    for k, law in enumerate(law_points(machine)):
        ends = f'low=-1000000000.0, high=1000000000.0, axis="{law.point.axis}", fitted=False'
        form = f'EffectParameter("form", "-", null=0.0, {ends}, default=1.0)'
        own, seen = (
            [form, *(f'EffectParameter("{name}", "-", null={null!r}, {ends})' for name, null in each.items())]
            for each in (nulls, dict(zip(WATCHED, (0.0, 1.0), strict=True)))
        )
        pieces.append(write_effect(law, f"LAW_{k}", "a free law", own, "any"))
        pieces.append(write_effect(law, f"WATCH_{k}", "counts", seen, "a tool of discovery", watch=True))
    return "\n\n\n".join(pieces) + "\n"


def load_effects(text: str, name: str) -> tuple[Effect, ...]:
    """Effects of a module's source, kept in a file of the cache for the code generator to read."""
    full = f"exodrake.effects.free_laws_{name}_{hashlib.sha256(text.encode()).hexdigest()[:12]}"
    file = write_if_different(cache_folder() / "laws" / f"{full.rsplit('.', 1)[1]}.py", text)
    return tuple(value for value in vars(module_of_file(full, file)).values() if isinstance(value, Effect))


def add_laws(machine: Machine) -> Machine:
    """The machine with its free laws and watches, after its own effects."""
    return once(
        machine,
        "add_laws",
        lambda: replace(machine, effects=(*machine.effects, *load_effects(module_text(machine), machine.name))),
    )


def robot_on(robot: Robot, machine: Machine) -> Robot:
    """A robot on its machine with further effects, at their null values."""
    return replace(robot, machine=machine, values=values_on(robot.values, robot.machine, machine))


def values_on(values: np.ndarray, before: Machine, after: Machine) -> np.ndarray:
    """Flat parameter vectors (..., n) on a machine with further effects, at their null values."""
    null = np.array([0.0 if p.null is None else p.null for p in after.parameters])
    out = np.broadcast_to(null, (*values.shape[:-1], len(null))).copy()
    out[..., [after.index[p.name] for p in before.parameters]] = values
    return out


def effect_text(
    law: LawPoint, form: FreeLaw, knots: np.ndarray, weights: np.ndarray, case: str, formulas: dict[str, str]
) -> str:
    """Source of the module of a law that was fitted to a case: knots and weights (8,) of its strongest channel.

    formulas: channel -> plain formula, if there is one.
    """
    single, axis = replace(law, identity=law.learned, forms=(form,)), law.point.axis
    value = law.arguments[law.point.name][0]
    each = 'null=k, low=-1e9, high=1e9, axis="{}", default=k, fitted=False) for i, k in enumerate({}, 1))'
    parameters = [
        f'EffectParameter("{SWITCH}", "-", null=0.0, low=0.0, high=1.0, axis="{axis}", default=1.0, fitted=False)',
        f'*(EffectParameter(f"k{{i}}", "{form.unit or "-"}", ' + each.format(axis, "AT"),
        '*(EffectParameter(f"w{i}", "-", ' + each.format(axis, "VALUES"),
    ]
    rows = {"AT": knots, "VALUES": weights}
    constants = "\n".join(f"{name} = ({', '.join(f'{v:.6g}' for v in row)})" for name, row in rows.items())
    title = f"{form.words[0].upper()}{form.words[1:]}, found in the logs of {case}."
    equation = f"law = {form.factor + ' ' if form.factor else ''}f(u)      u = {form.variable}"
    lines = [title, "", f"{value} -> {form.result or f'{value} + law'}      {equation}"]
    lines += [f"{channel or 'here'}: {text}" for channel, text in formulas.items()]
    lines += ["", *wrap(f"{NOTE} {SHAPES.get(form.kind, CURVES).format(unit=form.unit)}", 110)]
    stated = f"{form.words}, found in logs", parameters, f"fitted to {case}"
    effect = write_effect(single, "EFFECT", *stated, switch=SWITCH)
    used = ", ".join(n for n in FUNCTIONS if f"{n}(" in effect)
    header = HEADER.format(summary="\n".join(lines) + "\n", functions=used)
    if not form.advances:
        header = header.replace("from exodrake.model.part import State\n", "")
    return "\n\n\n".join([f"{header.rstrip()}\n\n{constants}", effect]) + "\n"


def robot_with(robot: Robot, text: str, channels: Sequence[str], knots: np.ndarray, weights: np.ndarray) -> Robot:
    """A robot with the effect of a module's text in it; knots, weights: (channels, 8), without it where all are 0."""
    (effect,) = load_effects(text, f"found_{robot.machine.name}")
    out = robot_on(robot, replace(robot.machine, effects=(*robot.machine.effects, effect)))
    on = [c for c, w in zip(channels, weights, strict=True) if w.any()]
    columns = [*zip(KNOTS, knots.T, strict=True), *zip(WEIGHTS, weights.T, strict=True)]
    given = {name: dict(zip(channels, map(float, column), strict=True)) for name, column in columns}
    return out.splice(effect.id, {SWITCH: dict.fromkeys(on, 1.0)} | given, on)


def write_law(folder: Path, identity: str, text: str, robot: Robot, case: str) -> list[Path]:
    """Writes a plugin folder: `effects/NAME.py` and `robot.yaml`."""
    module = f"effects/{identity.replace('.', '_')}.py"
    named = robot_text(robot, f"with a law found in {case} by exodrake diagnose")
    return write_folder(folder, {module: text.encode(), "robot.yaml": named.encode()})
