"""Prints the named points with the effects that sit on them.

A point's function asks one flag whether any effect is present there; only then does it call its spliced twin, in which
the value passes through each present effect in the shelf's order. Flags and numbers of a block's effects travel as one
array: as arguments of their own, some hundred of them, they would cost more than the physics.
"""

from __future__ import annotations

import ast
import math
import sys

from exodrake.core.effect import Effect, Number
from exodrake.core.machine import Machine, page_name
from exodrake.core.part import Block, Point
from exodrake.core.signal import ONE


def print_effects(machine: Machine, block: Block) -> str:
    """`fill_block_e(p)`: a flag for each point of the block (is an effect present?), then the effects' numbers."""
    start, flags = sum(machine.width(f.over) for f in block.fields), len(block.points)
    size = sum(machine.width(n.over) for e in machine.effects_on(block) for n in e.numbers)
    lines = ["@njit", f"def fill_{block.name}_e(p):", f"    e = np.zeros({flags + size})"]
    lines.append(f"    e[{flags}:] = p[{start}:{start + size}]")
    points = [point_key(block, p) for p in block.points]
    for effect in machine.effects_on(block):
        lines.append(f"    if {guard(machine, block, effect, None)}:")
        lines += [f"        e[{points.index(key)}] = 1.0" for key in effect.at]
    return "\n".join([*lines, "    return e"])


def point_key(block: Block, point: Point) -> str:
    """`page.function` of a point."""
    return f"{page_name(point.page or block.page)}.{point.name}"


def place(machine: Machine, block: Block, effect: Effect, number: Number) -> int:
    """Where a number of an effect starts in the block's array of flags and numbers."""
    at = len(block.points)
    for other in machine.effects_on(block):
        for n in other.numbers:
            if other.id == effect.id and n.name == number.name:
                return at
            at += machine.width(n.over)
    raise KeyError(f"{effect.id}.{number.name}")


def value_of(machine: Machine, block: Block, effect: Effect, number: Number, lane: str | None) -> str:
    """A number of a lane as source, or all of them where the point has no lane."""
    at = place(machine, block, effect, number)
    if number.over == ONE:
        return f"e[{at}]"
    if lane:
        return f"e[{at} + {lane}]"
    return "(" + ", ".join(f"e[{at + i}]" for i in range(machine.width(number.over))) + ")"


def compose_point(
    machine: Machine, block: Block, point: Point, function: ast.FunctionDef, effects: list[Effect]
) -> str:
    """The function of a point and its spliced twin."""
    key = point_key(block, point)
    names = [a.arg for a in function.args.args]
    name, flag = key.replace(".", "__"), [point_key(block, p) for p in block.points].index(key)
    header, summary = f"({', '.join(names)}):", f'    """{ast.get_docstring(function)}"""'
    body, value = spliced_body(machine, block, point, names, effects)
    call = f"        return {name}__spliced({', '.join(names)})"
    twin = ["@njit(_nrt=False)", f"def {name}__spliced{header}", *body, *([f"    return {value}"] if value else [])]
    plain = ["@njit(_nrt=False, forceinline=True)", f"def {name}{header}", summary, f"    if e[{flag}] != 0.0:"]
    plain += [call if value else call.replace("return ", "")]
    return "\n".join([*twin, "\n", *plain, *([f"    return {value}"] if value else [])])


def spliced_body(
    machine: Machine, block: Block, point: Point, names: list[str], effects: list[Effect]
) -> tuple[list[str], str]:
    """Lines through which the value passes, and its name; no name at a point that advances states."""
    key, lane = point_key(block, point), names[2] if point.over != ONE else None
    value, context = names[3 if lane else 2], names[4 if lane else 3 :]
    body, advances = [], False
    for effect in effects:
        act, own = effect.at[key], lane if effect.over == point.over or effect.over == ONE else None
        states = state_places(machine, block, effect, own)
        numbers = [value_of(machine, block, effect, n, own) for n in effect.numbers]
        arguments = ", ".join([value, *context, *numbers, *states])
        call = f"{page_name(sys.modules[act.__module__])}__{act.__name__}({arguments})"
        target = value if key not in effect.advances else ", ".join(states)
        advances = advances or key in effect.advances
        body += [f"    if {guard(machine, block, effect, own)}:", f"        {target} = {call}"]
    return body, "" if advances else value


def literal(value: float) -> str:
    """A neutral value as source."""
    return "inf" if math.isinf(value) else repr(float(value))


def guard(machine: Machine, block: Block, effect: Effect, lane: str | None) -> str:
    """Condition under which the effect is present."""
    first = effect.numbers[0]
    if first.over == ONE or lane:
        return f"{value_of(machine, block, effect, first, lane)} != {literal(first.neutral)}"
    at = place(machine, block, effect, first)
    return " or ".join(f"e[{at + i}] != {literal(first.neutral)}" for i in range(machine.width(first.over)))


def state_places(machine: Machine, block: Block, effect: Effect, lane: str | None) -> list[str]:
    """Where the effect's own states lie in the block's vector z, as source."""
    offset, places = 0, []
    for other in machine.effects_on(block):
        for state in other.states:
            width = machine.width(state.over)
            if other.id == effect.id:
                for k in range(state.width):
                    at = offset + k * width
                    own = (
                        [f"z[{at} + {lane}]"] if lane and state.over != ONE else [f"z[{at + i}]" for i in range(width)]
                    )
                    places += own
            offset += width * state.width
    return places
