"""Generates what the Drake leaf of a part calls: a function per event and per port of direct feedthrough.

Each takes a table (3 + signals read + start vectors read,) of addresses and a constant. The table names the leaf's
memory in the Context, its parameters, scratch memory, then the signals and start vectors read. The memory is the part's
state, then the signals that follow from the state alone (held signals). The scratch memory is a copy of it, then the
signals of direct feedthrough and the start vectors that the part fills. An event leaves the new memory in the scratch.
"""

from __future__ import annotations

import ast
import inspect

from exodrake.compiled.leaf_functions import held_signals, outer_reads
from exodrake.compiled.schedule import start_vectors
from exodrake.core.machine import Machine
from exodrake.core.part import Part, Task, prefix

FIRST_SIGNAL = 3  # in the table: after memory, parameters and scratch


def feedthrough_signals(part: Part) -> tuple[str, ...]:
    """Signals that answer an input of the part at once."""
    return tuple(signal for output in part.outputs if output.reads for signal in output.writes)


def width_of(machine: Machine, name: str) -> int:
    """Channels of a signal, or of a start vector, which is over the tendons."""
    return len(machine.channels(name)) if name in machine.signal else len(machine.axes.tendons)


def layout(machine: Machine, part: Part) -> dict[str, slice]:
    """Where what a part writes lies in its scratch memory: held signals, those of feedthrough, start vectors."""
    found, at = {}, sum(machine.part_size(part))
    filled = start_vectors(part) if part.fills_start else ()
    for name in (*held_signals(part), *feedthrough_signals(part), *filled):
        width = width_of(machine, name)
        found[name], at = slice(at, at + width), at + width
    return found


def start_reads(part: Part) -> tuple[str, ...]:
    """Start vectors that a part's `start` uses, and another part fills."""
    tree = ast.parse(inspect.getsource(part.module.start))
    used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    return () if part.fills_start else tuple(name for name in start_vectors(part) if name in used)


def memory_size(machine: Machine, part: Part) -> int:
    """Length of a leaf's memory: state and held signals."""
    held = sum(len(machine.channels(name)) for name in held_signals(part))
    return sum(machine.part_size(part)) + held


def reads_of(part: Part, reads: tuple[str, ...]) -> tuple[str, ...]:
    """Signals of other parts behind `reads`, those behind signals of the part's own direct feedthrough included."""
    found: dict[str, None] = {}
    for name in outer_reads(part, reads):
        output = next((o for o in part.outputs if name in o.writes), None)
        found |= dict.fromkeys(reads_of(part, output.reads) if output else (name,))
    return tuple(found)


def signals_read(part: Part) -> tuple[str, ...]:
    """Signals of other parts that a part reads while it runs."""
    reads = (name for item in (*part.tasks, *part.outputs) for name in reads_of(part, item.reads))
    return tuple(dict.fromkeys(reads))


def table_reads(part: Part) -> tuple[str, ...]:
    """Signals and start vectors in the table of addresses, in order."""
    return (*signals_read(part), *start_reads(part))


def event_tasks(part: Part) -> dict[str, list[Task]]:
    """Tasks by the event that runs them: `tick`, or the slots that they share."""
    found: dict[str, list[Task]] = {}
    for task in part.tasks:
        found.setdefault("_".join(["slot", *map(str, task.slots)]) if task.slots else "tick", []).append(task)
    return found


def generate_events(machine: Machine, part: Part) -> list[str]:
    """Functions of the table of addresses and a constant.

    `part__event__tick(table, dt)` and `part__event__slot_1_2(table, channel)` run tasks; `part__event__start` begins
    anew, `part__event__hold` fills the held signals; `part__port__output` and `part__port__start` are for output ports.
    """
    held = [(o.function, o.writes) for o in part.outputs if not o.reads]
    start = [("start", start_vectors(part))]
    lines = []
    for event, tasks in event_tasks(part).items():
        own = ["dt"] if not tasks[0].slots else ["channel"] if tasks[0].per_channel else []
        reads = tuple(dict.fromkeys(name for task in tasks for name in task.reads))
        calls = [*through_calls(part, reads), *((t.function, [*own, *t.reads]) for t in tasks), *held]
        lines.append(function(machine, part, f"event__{event}", own, reads_of(part, reads), calls))
    for output in (o for o in part.outputs if o.reads):
        reads = reads_of(part, output.reads)
        calls = [*through_calls(part, output.reads), (output.function, [*output.reads, *output.writes])]
        lines.append(function(machine, part, f"port__{output.function}", [], reads, calls, copy=False))
    lines.append(function(machine, part, "event__start", [], start_reads(part), [*start, *held], empty=True))
    lines.append(function(machine, part, "event__hold", [], (), held))
    if part.fills_start:
        lines.append(function(machine, part, "port__start", [], (), start, empty=True))
    return lines


def through_calls(part: Part, reads: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    """Calls that compute the signals of the part's own direct feedthrough among `reads`."""
    calls = []
    for output in (o for o in part.outputs if o.reads and set(o.writes) & set(reads)):
        calls += [*through_calls(part, output.reads), (output.function, [*output.reads, *output.writes])]
    return calls


def function(
    machine: Machine,
    part: Part,
    name: str,
    own: list[str],
    reads: tuple[str, ...],
    calls: list,
    copy: bool = True,
    empty: bool = False,
) -> str:
    """One function over the table of addresses; the memory is copied to the scratch and changed there, or emptied."""
    states, extra = machine.part_size(part)
    where, size = layout(machine, part), memory_size(machine, part)
    parameters = sum(parameter.part == part.name for parameter in machine.parameters)
    total, table = max([size, *(s.stop for s in where.values())]), table_reads(part)
    body = [f"p, scratch = vector(table[1], {parameters}), vector(table[2], {total})"]
    body += [f"state = {'scratch' if copy else f'vector(table[0], {size})'}"]
    if copy:
        body += [f"scratch[:{size}] = {'0.0' if empty else f'vector(table[0], {size})'}"]
    body += [f"x, z, n, e = state[:{states}], state[{states}:{states + extra}], fill_{part.name}_n(p), "]
    body[-1] += f"fill_{part.name}_e(p)"
    body += [
        f"{signal} = {'state' if s.stop <= size else 'scratch'}[{s.start}:{s.stop}]" for signal, s in where.items()
    ]
    for signal in reads:
        body.append(f"{signal} = vector(table[{FIRST_SIGNAL + table.index(signal)}], {width_of(machine, signal)})")
    unread = [name for name in start_vectors(part) if empty and name not in (*where, *reads)]
    body += [f"{name} = np.zeros({width_of(machine, name)})" for name in unread]
    module = prefix(part.module.__name__)
    body += [f"{module}__{called}(x, z, n, e, {', '.join(arguments)})" for called, arguments in calls]
    head = f"@njit(cache=True)\ndef {part.name}__{name}(table, {own[0] if own else '_'}):\n"
    return head + "\n".join("    " + line for line in body)
