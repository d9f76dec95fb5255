"""Generates the named points with the effects that sit on them.

A point's function asks one flag whether any effect is present there; only then does it call its spliced form, in which
the value passes through each present effect in the effect library's order. Flags and parameters of a part's effects
travel as one array: as arguments of their own, some hundred of them, they would cost more than the physics.
"""

from __future__ import annotations

import ast

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.core.part import SCALAR, Part, Point, module_name, prefix


def generate_effects(machine: Machine, part: Part) -> str:
    """`fill_part_e(p)`: a flag for each point of the part (is an effect present?), then the effects' parameters."""
    start, flags = sum(machine.width(f.axis) for f in part.fields), len(part.points)
    size = sum(machine.width(n.axis) for e in machine.effects_on(part) for n in e.parameters)
    lines = ["@njit", f"def fill_{part.name}_e(p):", f"    e = np.zeros({flags + size})"]
    lines.append(f"    e[{flags}:] = p[{start}:{start + size}]")
    points = [point_key(part, p) for p in part.points]
    for effect in machine.effects_on(part):
        lines.append(f"    if {guard(machine, part, effect, None)}:")
        lines += [f"        e[{points.index(key)}] = 1.0" for key in effect.at]
    return "\n".join([*lines, "    return e"])


def point_key(part: Part, point: Point) -> str:
    """`module.function` of a point."""
    return f"{module_name(point.module or part.module)}.{point.name}"


def parameter_values(
    machine: Machine, part: Part, effect: Effect, parameter: EffectParameter, channel: str | None
) -> list[str]:
    """A parameter of a channel as source, or those of all channels where the point has none."""
    all_parameters = [(other.id, n) for other in machine.effects_on(part) for n in other.parameters]
    before = all_parameters[: [(identity, n.name) for identity, n in all_parameters].index((effect.id, parameter.name))]
    at = len(part.points) + sum(machine.width(n.axis) for _, n in before)
    if parameter.axis != SCALAR and channel:
        return [f"e[{at} + {channel}]"]
    return [f"e[{at + i}]" for i in range(machine.width(parameter.axis))]


def compose_point(machine: Machine, part: Part, point: Point, function: ast.FunctionDef, effects: list[Effect]) -> str:
    """The function of a point and its spliced form."""
    key = point_key(part, point)
    names = [a.arg for a in function.args.args]
    name, flag = (
        f"{prefix((point.module or part.module).__name__)}__{point.name}",
        [point_key(part, p) for p in part.points].index(key),
    )
    channel = names[2] if point.axis != SCALAR else None
    value, context = names[3 if channel else 2], names[4 if channel else 3 :]
    body = []  # lines through which the value passes
    for effect in effects:
        act, own = effect.at[key], channel if effect.axis == point.axis or effect.axis == SCALAR else None
        states = state_indices(machine, part, effect, own)
        values = [parameter_values(machine, part, effect, n, own) for n in effect.parameters]
        parameters = [v[0] if len(v) == 1 else f"({', '.join(v)})" for v in values]
        given = named_by(effect, key, context, len(parameters) + len(states))
        call = f"{prefix(act.__module__)}__{act.__name__}({', '.join([value, *given, *parameters, *states])})"
        filtered = [value, *states] if key in effect.filters else [value]
        target = ", ".join(states if key in effect.advances else filtered)
        body += [f"    if {guard(machine, part, effect, own)}:", f"        {target} = {call}"]
    returns = [] if any(key in effect.advances for effect in effects) else [f"    return {value}"]
    header, call = f"({', '.join(names)}):", f"{name}__spliced({', '.join(names)})"
    spliced = ["@njit(_nrt=False)", f"def {name}__spliced{header}", *body, *returns]
    plain = ["@njit(_nrt=False, forceinline=True)", f"def {name}{header}", f'    """{ast.get_docstring(function)}"""']
    plain += [f"    if e[{flag}] != 0.0:", f"        {'return ' if returns else ''}{call}", *returns]
    return "\n".join([*spliced, "\n", *plain])


def named_by(effect: Effect, key: str, context: list[str], own: int) -> list[str]:
    """Of a point's arguments after the value those that the effect's law takes: those that it names, else all.

    Args:
        effect: that acts there.
        key: of the point.
        context: names of the point's arguments after the value.
        own: number of the law's last arguments, which are the effect's parameters and states.

    Raises:
        InputError: for a law that takes something else.
    """
    code = effect.at[key].__code__
    names = list(code.co_varnames[1 : max(1, code.co_argcount - own)])
    if code.co_argcount > own and set(names) <= set(context):
        return names
    if code.co_argcount == own + 1 + len(context):
        return context
    given, taken = ", ".join(["a value", *context]), ", ".join(code.co_varnames[: code.co_argcount])
    raise InputError(
        f"{effect.id}: {code.co_name}({taken}) does not fit {key}, which gives {given}; "
        f"{own} parameters and states of the effect follow"
    )


def guard(machine: Machine, part: Part, effect: Effect, channel: str | None) -> str:
    """Condition under which the effect is present."""
    first = effect.parameters[0]
    return " or ".join(f"{v} != {float(first.null)!r}" for v in parameter_values(machine, part, effect, first, channel))


def state_indices(machine: Machine, part: Part, effect: Effect, channel: str | None) -> list[str]:
    """Where the effect's own states lie in the part's vector z, as source."""
    offset, places = 0, []
    for owner, state in ((other.id, state) for other in machine.effects_on(part) for state in other.states):
        width = machine.width(state.axis)
        for at in range(offset, offset + width * state.width, width) if owner == effect.id else ():
            one = channel and state.axis != SCALAR
            places += [f"z[{at} + {channel}]"] if one else [f"z[{at + i}]" for i in range(width)]
        offset += width * state.width
    return places
