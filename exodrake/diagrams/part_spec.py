"""What the Drake leaf of a part is made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.events import event_tasks, layout, memory_size, reads_of, start_reads, table_reads, width_of
from exodrake.compiled.memory import addresses
from exodrake.compiled.schedule import start_vectors
from exodrake.core.machine import Machine
from exodrake.core.part import Part, Task
from exodrake.diagrams.leaf_spec import Feedthrough, InputSpec, LeafSpec, PeriodicUpdate


def parameters_of(machine: Machine, part: Part) -> slice:
    """Positions of a part's parameters in the flat vector."""
    places = [i for i, parameter in enumerate(machine.parameters) if parameter.part == part.name]
    return slice(places[0], places[-1] + 1) if places else slice(0, 0)


def start_arrays(machine: Machine, values: np.ndarray) -> dict[str, np.ndarray]:
    """The start vectors (tendons,) of the whole machine for these parameters [SI]."""
    found = {}
    for part in (part for part in machine.parts if part.fills_start):
        scratch, where = scratch_of(machine, part), layout(machine, part)
        parameters = np.array(values[parameters_of(machine, part)])
        part_function(machine, part, "port__start")(addresses(scratch, parameters, scratch), 0)
        found |= {name: scratch[where[name]].copy() for name in start_vectors(part)}
    return found


def part_function(machine: Machine, part: Part, name: str) -> Callable:
    """A compiled function of a part over its table of addresses."""
    return getattr(compile_machine(machine), f"{part.name}__{name}")


def scratch_of(machine: Machine, part: Part) -> np.ndarray:
    """Scratch memory of a part's leaf."""
    return np.zeros(max([memory_size(machine, part), *(at.stop for at in layout(machine, part).values())]))


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


def initial_memory(machine: Machine, part: Part, parameters: np.ndarray, start: Mapping[str, np.ndarray]) -> np.ndarray:
    """A leaf's memory at the start: the state, then the signals that it holds.

    Args:
        machine: the machine.
        part: one of its parts.
        parameters: (n,) array of the part's parameters [SI].
        start: the start vectors (tendons,) of the machine.
    """
    scratch = scratch_of(machine, part)
    read = [start.get(name, scratch) for name in table_reads(part)]  # `start` reads start vectors alone
    part_function(machine, part, "event__start")(addresses(scratch, parameters, scratch, *read), 0)
    return scratch[: memory_size(machine, part)]


def alone(machine: Machine, name: str) -> InputSpec:
    """An input port for one signal or start vector."""
    width = width_of(machine, name)
    return InputSpec(width, {name: slice(0, width)})


def updates_of(
    machine: Machine, part: Part, ports: Mapping[str, InputSpec], substeps: int
) -> tuple[PeriodicUpdate, ...]:
    """The periodic events of a part."""
    return tuple(
        PeriodicUpdate(part_function(machine, part, f"event__{event}"), constant, reads, *when)
        for event, tasks in event_tasks(part).items()
        for reads in [ports_behind(part, ports, tuple(name for task in tasks for name in task.reads))]
        for constant, *when in times(machine, tasks[0], substeps)
    )


def computed_of(machine: Machine, part: Part, ports: Mapping[str, InputSpec]) -> tuple[Feedthrough, ...]:
    """The ports of a part that are computed: those of direct feedthrough, and of the start vectors that it fills."""
    through = [
        Feedthrough(part_function(machine, part, f"port__{o.function}"), ports_behind(part, ports, o.reads), o.writes)
        for o in part.outputs
        if o.reads
    ]
    if part.fills_start:
        through.append(Feedthrough(part_function(machine, part, "port__start"), (), start_vectors(part)))
    return tuple(through)


def ports_behind(part: Part, ports: Mapping[str, InputSpec], reads: tuple[str, ...]) -> tuple[str, ...]:
    """Input ports that carry signals, or say what depends on them."""
    carrier = {signal: name for name, port in ports.items() for signal in port.signals}
    return tuple(dict.fromkeys(name if name in ports else carrier[name] for name in reads_of(part, reads)))


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
    ports = dict({name: alone(machine, name) for name in table_reads(part)} if inputs is None else inputs)
    parameters, start = np.array(values[parameters_of(machine, part)]), start_arrays(machine, values)
    return LeafSpec(
        name=part.name,
        inputs=ports,
        parameters=parameters,
        parameter_names=tuple(p.name for p in machine.parameters if p.part == part.name),
        memory=initial_memory(machine, part, parameters, start),
        signals=layout(machine, part),
        reads=table_reads(part),
        updates=updates_of(machine, part, ports, substeps),
        start=part_function(machine, part, "event__start"),
        hold=part_function(machine, part, "event__hold"),
        start_vectors={name: start[name] for name in start_reads(part)},
        computed=computed_of(machine, part, ports),
        scratch_size=len(scratch_of(machine, part)),
    )
