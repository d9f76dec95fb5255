"""Prints, for each part, where its numbers lie in the flat vector, and what its Drake leaf calls."""

from __future__ import annotations

from exodrake.compiled.splice import print_effects
from exodrake.core.machine import Machine, page_name
from exodrake.core.part import Block


def print_leaves(machine: Machine) -> list[str]:
    """Views of the numbers, and one entry function per task and output of each block."""
    lines = []
    for block in machine.blocks:
        lines += [print_numbers(machine, block), print_effects(machine, block), *print_entries(machine, block)]
    return lines


def print_numbers(machine: Machine, block: Block) -> str:
    """`fill_block_n(p)`: the block's own numbers, the start of its own vector."""
    count = sum(machine.width(f.over) for f in block.fields)
    return f"@njit\ndef fill_{block.name}_n(p):\n    return p[:{count}]"


def held_wires(block: Block) -> tuple[str, ...]:
    """Wires that follow from the block's state alone; its Drake leaf holds them in the Context beside the state."""
    return tuple(wire for output in block.outputs if not output.reads for wire in output.writes)


def outer_reads(block: Block, reads: tuple[str, ...]) -> tuple[str, ...]:
    """Wires of `reads` that come from other parts."""
    return tuple(wire for wire in reads if wire not in held_wires(block))


def print_entries(machine: Machine, block: Block) -> list[str]:
    """What a Drake leaf calls, one function per task and output, compiled and cached.

    `block__leaf__task(state, held wires..., p, [dt or lane,] wires read...)` runs a task, then the outputs that it
    changes; `block__leaf__hold(state, held wires..., p)` fills these for a state; and
    `block__leaf__output(state, p, reads..., writes...)` computes wires of direct feedthrough.
    """
    held = held_wires(block)
    follow = [(o.function, o.writes) for o in block.outputs if not o.reads]
    lines = []
    for task in block.tasks:
        own = ["dt"] if not task.slots else ["lane"] if task.lanes else []
        given = ["state", *held, "p", *own, *outer_reads(block, task.reads)]
        lines.append(entry(machine, block, task.function, given, [(task.function, [*own, *task.reads]), *follow]))
    for output in (o for o in block.outputs if o.reads):
        given = ["state", "p", *output.reads, *output.writes]
        calls = [(output.function, [*output.reads, *output.writes])]
        lines.append(entry(machine, block, output.function, given, calls))
    return [*lines, entry(machine, block, "hold", ["state", *held, "p"], follow)]


def entry(machine: Machine, block: Block, name: str, given: list[str], calls: list) -> str:
    """One entry function: calls of the page's functions, (function, arguments) each."""
    own, extra = machine.part_size(block)
    page, numbers = page_name(block.page), f"fill_{block.name}_n(p), fill_{block.name}_e(p)"
    body = [f"x, z, n, e = state[:{own}], state[{own}:{own + extra}], {numbers}"]
    body += [f"{page}__{function}(x, z, n, e, {', '.join(arguments)})" for function, arguments in calls]
    head = f"@njit(cache=True)\ndef {block.name}__leaf__{name}({', '.join(given)}):\n"
    return head + "\n".join("    " + line for line in body)
