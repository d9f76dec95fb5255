"""What the Drake leaf of a part is made of."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.events import event_tasks, layout, memory_size, reads_of, signals_read
from exodrake.compiled.leaf_functions import held_signals
from exodrake.core.errors import InputError
from exodrake.core.machine import Machine, state_size
from exodrake.core.part import Part, Task
from exodrake.diagrams.leaf import Feedthrough, InputSpec, LeafSpec, PeriodicUpdate


def parameters_of(machine: Machine, part: Part) -> slice:
    """Where a part's parameters lie in the flat vector."""
    places = [i for i, parameter in enumerate(machine.parameters) if parameter.part == part.name]
    return slice(places[0], places[-1] + 1) if places else slice(0, 0)


def state_of(machine: Machine, part: Part) -> slice:
    """Where a part's states lie in the flat state."""
    start = 0
    for other in machine.parts:
        size = sum(machine.part_size(other))
        if other.name == part.name:
            return slice(start, start + size)
        start += size
    raise InputError(f"{machine.name} has no part {part.name!r}")


def start_state(machine: Machine, values: np.ndarray) -> np.ndarray:
    """The flat state of all parts at the start, for these parameters [SI]."""
    state = np.zeros(state_size(machine))
    compile_machine(machine).begin(values, state)
    return state


def times(machine: Machine, task: Task, substeps: int) -> list[tuple[float, float, float]]:
    """(constant, period [s], offset [s]) of the periodic events of a task.

    A sampled task runs in the middle of its slot, all ticks of the plant in the half slot before it, a log at the
    slot's end: no two of them ever at the same time, where a rounding error would decide which comes first.
    """
    if task.slots:
        return [
            (k if task.per_channel else 0, machine.frame, (slot + 0.5) * machine.slot)
            for k, slot in enumerate(task.slots)
        ]
    dt, half = machine.slot / substeps, 0.5 * machine.slot
    return [(dt, machine.slot, half * (i + 0.5) / substeps) for i in range(substeps)]


def initial_memory(machine: Machine, part: Part, parameters: np.ndarray, state: np.ndarray) -> np.ndarray:
    """A leaf's memory for its own state: the state, then the signals that it holds."""
    memory, size = np.zeros(memory_size(machine, part)), len(state)
    memory[:size] = state
    where = layout(machine, part)
    held = [memory[where[name]] for name in held_signals(part)]
    getattr(compile_machine(machine), f"{part.name}__leaf__hold")(memory[:size], *held, parameters)
    return memory


def separate_inputs(machine: Machine, part: Part) -> dict[str, InputSpec]:
    """An input port for each signal read."""
    widths = {name: machine.width(machine.signal[name].axis) for name in signals_read(part)}
    return {name: InputSpec(width, {name: slice(0, width)}) for name, width in widths.items()}


def reads_in(tasks: list[Task]) -> tuple[str, ...]:
    """Signals that some tasks read."""
    return tuple(name for task in tasks for name in task.reads)


def part_spec(
    machine: Machine,
    part: Part,
    values: np.ndarray,
    substeps: int = 1,
    inputs: Mapping[str, InputSpec] | None = None,
) -> LeafSpec:
    """The specification of one part, in the state in which the whole machine starts.

    Args:
        machine: the machine.
        part: one of its parts.
        values: (n,) array of all parameters of the machine [SI].
        substeps: plant ticks per slot.
        inputs: the input ports; None: one for each signal read.
    """
    module, place = compile_machine(machine), parameters_of(machine, part)
    state = start_state(machine, values)[state_of(machine, part)]
    ports = dict(separate_inputs(machine, part) if inputs is None else inputs)
    carrier = {signal: name for name, port in ports.items() for signal in port.signals}

    def needed(reads: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(dict.fromkeys(carrier[name] for name in reads_of(part, reads)))

    updates = [
        PeriodicUpdate(getattr(module, f"{part.name}__event__{event}"), constant, needed(reads_in(tasks)), *when)
        for event, tasks in event_tasks(part).items()
        for constant, *when in times(machine, tasks[0], substeps)
    ]
    through = [
        Feedthrough(getattr(module, f"{part.name}__port__{o.function}"), needed(o.reads), o.writes)
        for o in part.outputs
        if o.reads
    ]
    where = layout(machine, part)
    memory = initial_memory(machine, part, values[place], state)
    return LeafSpec(
        name=part.name,
        inputs=ports,
        parameters=values[place],
        parameter_names=tuple(parameter.name for parameter in machine.parameters[place]),
        memory=memory,
        signals=where,
        reads=signals_read(part),
        updates=tuple(updates),
        feedthrough=tuple(through),
        scratch_size=max([len(memory), *(at.stop for at in where.values())]),
    )
