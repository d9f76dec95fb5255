"""Prints, for each part, where its numbers lie in the flat vector, and what its Drake leaf calls."""

from __future__ import annotations

from exodrake.compiled.splice import print_effects
from exodrake.core.machine import Machine
from exodrake.core.part import Part, prefix


def print_leaves(machine: Machine) -> list[str]:
    """Views of the numbers, and one entry function per task and output of each block."""
    lines = []
    for part in machine.parts:
        lines += [print_parameters(machine, part), print_effects(machine, part), *print_entries(machine, part)]
    return lines


def print_parameters(machine: Machine, part: Part) -> str:
    """`fill_block_n(p)`: the block's own numbers, the start of its own vector."""
    count = sum(machine.width(f.axis) for f in part.fields)
    return f"@njit\ndef fill_{part.name}_n(p):\n    return p[:{count}]"


def held_signals(part: Part) -> tuple[str, ...]:
    """Wires that follow from the block's state alone; its Drake leaf holds them in the Context beside the state."""
    return tuple(wire for output in part.outputs if not output.reads for wire in output.writes)


def outer_reads(part: Part, reads: tuple[str, ...]) -> tuple[str, ...]:
    """Wires of `reads` that come from other parts."""
    return tuple(wire for wire in reads if wire not in held_signals(part))


def print_entries(machine: Machine, part: Part) -> list[str]:
    """What a Drake leaf calls, one function per task and output, compiled and cached.

    `block__leaf__task(state, held wires..., p, [dt or channel,] wires read...)` runs a task, then the outputs that it
    changes; `block__leaf__hold(state, held wires..., p)` fills these for a state; and
    `block__leaf__output(state, p, reads..., writes...)` computes wires of direct feedthrough.
    """
    held = held_signals(part)
    follow = [(o.function, o.writes) for o in part.outputs if not o.reads]
    lines = []
    for task in part.tasks:
        own = ["dt"] if not task.slots else ["channel"] if task.per_channel else []
        given = ["state", *held, "p", *own, *outer_reads(part, task.reads)]
        lines.append(entry(machine, part, task.function, given, [(task.function, [*own, *task.reads]), *follow]))
    for output in (o for o in part.outputs if o.reads):
        given = ["state", "p", *output.reads, *output.writes]
        calls = [(output.function, [*output.reads, *output.writes])]
        lines.append(entry(machine, part, output.function, given, calls))
    return [*lines, entry(machine, part, "hold", ["state", *held, "p"], follow)]


def entry(machine: Machine, part: Part, name: str, given: list[str], calls: list) -> str:
    """One entry function: calls of the page's functions, (function, arguments) each."""
    own, extra = machine.part_size(part)
    page, parameters = prefix(part.module.__name__), f"fill_{part.name}_n(p), fill_{part.name}_e(p)"
    body = [f"x, z, n, e = state[:{own}], state[{own}:{own + extra}], {parameters}"]
    body += [f"{page}__{function}(x, z, n, e, {', '.join(arguments)})" for function, arguments in calls]
    head = f"@njit(cache=True)\ndef {part.name}__leaf__{name}({', '.join(given)}):\n"
    return head + "\n".join("    " + line for line in body)
