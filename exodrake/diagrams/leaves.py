"""Prints, for each part, its numbers as named tuples taken from the flat vector, and what its Drake leaf calls."""

from __future__ import annotations

from exodrake.block import ONE, Block
from exodrake.diagrams.machine import Machine, page_name


def print_leaves(machine: Machine) -> list[str]:
    """Named tuples, their unpacking, and one entry function per task and output of each block."""
    lines = []
    for block in machine.blocks:
        lines += [print_numbers(machine, block), print_effects(machine, block), *print_entries(machine, block)]
    return lines


def print_tuple(machine: Machine, name: str, fields: list[tuple[str, str]], start: int) -> tuple[str, int]:
    """A named tuple and the function that fills it from p[start:], with the place after its last number."""
    items, at = [], start
    for _, over in fields:
        width = machine.width(over)
        items.append(f"p[{at}]" if over == ONE else "(" + "".join(f"p[{at + i}], " for i in range(width)) + ")")
        at += width
    text = f"{name} = namedtuple({name!r}, {[f for f, _ in fields]!r})\n\n\n@njit\ndef fill_{name}(p):\n"
    return text + f"    return {name}({', '.join(items)})", at


def print_numbers(machine: Machine, block: Block) -> str:
    """The block's own numbers, from the start of its own vector."""
    return print_tuple(machine, f"{block.name}_n", [(f.name, f.over) for f in block.fields], 0)[0]


def print_effects(machine: Machine, block: Block) -> str:
    """The numbers of the effects on the block, after its own."""
    start = sum(machine.width(f.over) for f in block.fields)
    fields = [(f"{e.slug}__{n.name}", n.over) for e in machine.effects_on(block) for n in e.numbers]
    return print_tuple(machine, f"{block.name}_e", fields, start)[0]


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
