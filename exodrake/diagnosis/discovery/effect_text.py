"""Source code of free laws as effects, and of watches that record the ranges of their variables."""

from __future__ import annotations

from collections.abc import Sequence

from exodrake.core.part import Point
from exodrake.diagnosis.discovery.forms import CURVE, HYSTERESIS, PLACE, RELAXATION, REMEMBERS, Form, LawPoint

SIZE = 8  # knots of a curve, or elements of a memory
BINS = 12  # in which a watch counts
KNOTS = tuple(f"k{i + 1}" for i in range(SIZE))
WEIGHTS = tuple(f"w{i + 1}" for i in range(SIZE))
ELEMENTS = (*(f"s{i + 1}" for i in range(SIZE)), "last", "started")
COUNTS = tuple(f"c{i + 1}" for i in range(BINS))
SEEN = ("low_seen", "high_seen", *COUNTS, "place", "last", "started")
HEADER = '''"""{summary}"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.effects.law_table import curve, dragged, faded, inside, slope, stop_operator
'''


def listed(names: Sequence[str]) -> str:
    """Names with commas."""
    return ", ".join(names)


def remembers(law: LawPoint) -> bool:
    """Whether any form of the point has states."""
    return any(f.kind in REMEMBERS for f in law.forms)


def function_name(law: LawPoint, other: str = "") -> str:
    """Name of the function of a law at its own or at another point of the part."""
    return "__".join(part for part in (law.key.replace(".", "__"), other) if part)


def law_source(law: LawPoint, switch: str = "form") -> str:
    """Functions of the law at all its points; `switch`: name of its first parameter, the number of the form."""
    extra = (switch, *KNOTS, *WEIGHTS, *(ELEMENTS if remembers(law) else ()))
    pieces = [value_source(law, extra, switch)]
    pieces += [advance_source(law, name, extra, switch) for name in advancing(law)]
    pieces += [rate_source(law, k, f, extra, switch) for k, f in enumerate(law.forms, 1) if f.rate[0]]
    return "\n\n\n".join(pieces)


def advancing(law: LawPoint) -> list[str]:
    """Points beside the law's own at which its states advance."""
    return list(dict.fromkeys(f.advances for f in law.forms if f.advances and f.advances != law.point.name))


def summed(form: Form) -> str:
    """f(u), or the sum of the elements."""
    if form.kind in (CURVE, PLACE):
        u = form.variable if form.kind == CURVE else "s1"
        return f"curve({u}, {listed(KNOTS)}, {listed(WEIGHTS)})"
    elements = ELEMENTS[:SIZE]
    terms = zip(WEIGHTS, elements, KNOTS, strict=True)
    return "(" + " + ".join(f"{w} * {s}" + (f" / {k}" if form.kind == HYSTERESIS else "") for w, s, k in terms) + ")"


def value_source(law: LawPoint, extra: Sequence[str], switch: str) -> str:
    """The function at the law's point."""
    filters = any(f.advances == law.point.name for f in law.forms)
    states = f", {listed(ELEMENTS)}" if filters else ""
    value = law.arguments[0]
    lines = [f"def {function_name(law)}({listed((*law.arguments, *extra))}):", '    """Value with the law in it."""']
    for k, form in enumerate(law.forms, 1):
        lines.append(f"    if {switch} == {k}.0:")
        if form.advances == law.point.name:
            lines += [f"        {line}" for line in moved(form, "period")]
        lines.append(f"        law = {form.factor + ' * ' if form.factor else ''}{summed(form)}")
        lines.append(f"        return {form.result or f'{value} + law'}{states}")
    return "\n".join([*lines, f"    return {value}{states}"])


def moved(form: Form, dt: str = "dt") -> list[str]:
    """Lines that advance the elements of a law by the move of its variable."""
    change = form.variable if form.moves else f"{form.variable} - last if started > 0.0 else 0.0"
    lines, elements = [f"change = {change}"], ELEMENTS[:SIZE]
    for s, k in zip(elements, KNOTS, strict=True):
        step = {
            PLACE: f"{s} + change",
            HYSTERESIS: f"stop_operator({s}, change, {k})",
            RELAXATION: f"faded({s}, change, {dt}, {k})",
        }[form.kind]
        lines.append(f"{s} = {step}")
    return [*lines, f"last, started = {'0.0' if form.moves else form.variable}, 1.0"]


def advance_source(law: LawPoint, name: str, extra: Sequence[str], switch: str) -> str:
    """The function at a point where states of the law advance."""
    lines = [f"def {function_name(law, name)}({listed((*law.advanced[name], *extra))}):"]
    lines.append('    """States of the law after a tick."""')
    for k, form in enumerate(law.forms, 1):
        if form.advances == name:
            lines += [f"    if {switch} == {k}.0:", *(f"        {line}" for line in moved(form))]
    return "\n".join([*lines, f"    return {listed(ELEMENTS)}"])


def rate_source(law: LawPoint, k: int, form: Form, extra: Sequence[str], switch: str) -> str:
    """The function at the point that takes the rate of the law's value."""
    name, variable, result = form.rate
    lines = [f"def {function_name(law, name)}({listed((*law.advanced[name], *extra))}):"]
    lines += ['    """Rate of the value with the law in it."""', f"    if {switch} != {k}.0:"]
    lines.append(f"        return {law.advanced[name][0]}")
    called = result.replace("slope", f"slope({variable}, {listed(KNOTS)}, {listed(WEIGHTS)})")
    return "\n".join([*lines, f"    return {called}"])


def watch_source(law: LawPoint) -> str:
    """Functions of a watch: range and counts of the variable of form `form`; of the law's scale for one number more."""
    extra = ("form", "low", "high", *SEEN)
    count = [f"{c} + inside(u, low, high, {i}.0, {BINS}.0)" for i, c in enumerate(COUNTS)]
    seen = f"u if started == 0.0 else min(low_seen, u), u if started == 0.0 else max(high_seen, u), {listed(count)}"
    value, pieces = law.arguments[0], []
    own = [(k, f.variable) for k, f in enumerate(law.forms, 1) if not f.advances] + [(len(law.forms) + 1, law.scale)]
    lines = [f"def {function_name(law, 'watch')}({listed((*law.arguments, *extra))}):", '    """Counts."""']
    for k, variable in own:
        lines += [
            f"    if form == {k}.0:",
            f"        u = {variable}",
            f"        return {value}, {seen}, place, last, 1.0",
        ]
    pieces.append("\n".join([*lines, f"    return {value}, {listed(SEEN)}"]))
    for name in {f.advances: None for f in law.forms if f.advances}:
        pieces.append(watch_moves(law, name, extra, seen))
    return "\n\n\n".join(pieces)


def watch_moves(law: LawPoint, name: str, extra: Sequence[str], seen: str) -> str:
    """The watch at a point where states advance: the place that moves add up to."""
    own = name == law.point.name
    arguments = law.arguments if own else law.advanced[name]
    lines = [f"def {function_name(law, name)}__watch({listed((*arguments, *extra))}):", '    """Counts."""']
    for k, form in enumerate(law.forms, 1):
        if form.advances == name:
            u = f"place + {form.variable}" if form.moves else form.variable
            lines += [f"    if form == {k}.0:", f"        u = {u}", f"        return {seen}, u, last, 1.0"]
    return "\n".join([*lines, f"    return {listed(SEEN)}"])


def effect_source(law: LawPoint, name: str, summary: str, parameters: Sequence[str], source: str) -> str:
    """The effect of a law; `parameters`: source of each."""
    points = {law.key: function_name(law)}
    module = law.key.split(".")[0]
    points |= {f"{module}.{p}": function_name(law, p) for p in advancing(law)}
    points |= {f"{module}.{f.rate[0]}": function_name(law, f.rate[0]) for f in law.forms if f.rate[0]}
    states = states_source(ELEMENTS, law.point) if remembers(law) else ""
    filters = [law.key] if any(f.advances == law.point.name for f in law.forms) else []
    return stated(name, law.identity, summary, points, parameters, states, advancing(law), filters, module, source)


def watch_effect_source(law: LawPoint, name: str) -> str:
    """The effect that is a watch."""
    module = law.key.split(".")[0]
    points, others = {law.key: function_name(law, "watch")}, advancing(law)
    points |= {f"{module}.{p}": f"{function_name(law, p)}__watch" for p in others}
    parameters = [parameter_source(p, law.point, "-", null) for p, null in (("form", 0.0), ("low", 0.0), ("high", 1.0))]
    states, summary = states_source(SEEN, law.point), "counts where a variable goes"
    identity = f"{law.identity}_watch"
    return stated(name, identity, summary, points, parameters, states, others, [law.key], module, "a tool of discovery")


def states_source(names: Sequence[str], point: Point) -> str:
    """States of an effect, one by one in this order."""
    return listed([f'State("{name}", "{point.axis}")' for name in names])


def parameter_source(
    name: str, point: Point, unit: str, null: float, default: float | None = None, fitted: bool = False
) -> str:
    """A parameter of a law, for each channel of its point."""
    rest = "" if default is None else f", default={default!r}"
    rest += "" if fitted else ", fitted=False"
    ends = f"low={-1e9!r}, high={1e9!r}"
    return f'EffectParameter("{name}", "{unit}", null={null!r}, {ends}, axis="{point.axis}"{rest})'


def stated(
    name: str, identity: str, summary: str, points: dict[str, str], parameters: Sequence[str], states: str,
    advances: Sequence[str], filters: Sequence[str], module: str, source: str,
) -> str:  # fmt: skip
    """The definition of an effect."""
    at = listed([f'"{point}": {function}' for point, function in points.items()])
    lines = [
        f"{name} = Effect(",
        f'    id="{identity}",',
        f"    summary={summary!r},",
        '    signature="none of its own",',
    ]
    lines += [f"    source={source!r},", f"    at={{{at}}},", "    parameters=("]
    lines += [f"        {p}," for p in parameters]
    lines += ["    ),", *([f"    states=({states},),"] if states else [])]
    lines += [f"    advances={tuple(f'{module}.{a}' for a in advances)!r},"] if advances else []
    lines += [f"    filters={tuple(filters)!r},"] if filters else []
    return "\n".join([*lines, '    family="law",', '    not_tried="a free law, which `--discover` tries",', ")"])
