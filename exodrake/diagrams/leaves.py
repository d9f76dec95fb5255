"""Prints, for each part, its numbers as named tuples taken from the flat vector, and the functions that a Drake leaf calls."""

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


def print_entries(machine: Machine, block: Block) -> list[str]:
    """`block__leaf__function(x, z, p, ...)` for each task and output, compiled and cached for the Drake leaf."""
    page, lines = page_name(block.page), []
    for task in block.tasks:
        own = ["dt"] if not task.slots else ["lane"] if task.lanes else []
        lines.append(entry(block.name, page, task.function, [*own, *task.reads]))
    for output in block.outputs:
        lines.append(entry(block.name, page, output.function, [*output.reads, *output.writes]))
    lines.append(entry(block.name, page, "start", ["start_stroke"]))
    return lines


def entry(block: str, page: str, function: str, arguments: list[str]) -> str:
    """One entry function."""
    given = ", ".join(arguments)
    call = f"{page}__{function}(x, z, fill_{block}_n(p), fill_{block}_e(p), {given})"
    return f"@njit(cache=True)\ndef {block}__leaf__{function}(x, z, p, {given}):\n    {call}"
