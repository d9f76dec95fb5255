"""Generates, for each part, views of its parameters and functions over its own state, for replays and Drake systems."""

from __future__ import annotations

from exodrake.compiled.schedule import start_vectors
from exodrake.compiled.splice import generate_effects
from exodrake.core.machine import Machine
from exodrake.core.part import Part, prefix


def generate_leaves(machine: Machine) -> list[str]:
    """Views of the parameters, and one entry function per task and output of each part."""
    lines = []
    for part in machine.parts:
        lines += [generate_parameters(machine, part), generate_effects(machine, part), *generate_entries(machine, part)]
    return lines


def generate_parameters(machine: Machine, part: Part) -> str:
    """`fill_part_n(p)`: the part's own parameters, the start of its own vector."""
    count = sum(machine.width(f.axis) for f in part.fields)
    return f"@njit\ndef fill_{part.name}_n(p):\n    return p[:{count}]"


def held_signals(part: Part) -> tuple[str, ...]:
    """Signals that follow from a part's state alone."""
    return tuple(wire for output in part.outputs if not output.reads for wire in output.writes)


def outer_reads(part: Part, reads: tuple[str, ...]) -> tuple[str, ...]:
    """Signals of `reads` that the part does not hold."""
    return tuple(wire for wire in reads if wire not in held_signals(part))


def generate_entries(machine: Machine, part: Part) -> list[str]:
    """One function per task and output, compiled and cached.

    `part__leaf__task(state, held..., p, [dt or channel,] reads...)` runs a task, then the outputs that it changes;
    `part__leaf__hold(state, held..., p)` fills the held signals for a state; and
    `part__leaf__output(state, p, reads..., writes...)` computes signals of direct feedthrough.
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
    """One entry function: calls of the part's functions, (function, arguments) each."""
    own, extra = machine.part_size(part)
    module, parameters = prefix(part.module.__name__), f"fill_{part.name}_n(p), fill_{part.name}_e(p)"
    body = [f"x, z, n, e = state[:{own}], state[{own}:{own + extra}], {parameters}"]
    body += [f"{module}__{function}(x, z, n, e, {', '.join(arguments)})" for function, arguments in calls]
    head = f"@njit(cache=True)\ndef {part.name}__leaf__{name}({', '.join(given)}):\n"
    return head + "\n".join("    " + line for line in body)


def generate_equations(machine: Machine, part: Part) -> list[str]:
    """One function per task, output and the start of a part, for its Drake system: see `equations`."""
    tasks = [(t.function, [*(["dt"] if not t.slots else ["channel"] * t.per_channel), *t.reads]) for t in part.tasks]
    outputs = [(o.function, [*o.reads, *o.writes]) for o in part.outputs]
    calls = [*tasks, *outputs, ("start", list(start_vectors(part)))]
    lines = [entry(machine, part, name, ["state", "p", *given], [(name, given)]) for name, given in calls]
    return [line.replace("__leaf__", "__equation__", 1) for line in lines]
