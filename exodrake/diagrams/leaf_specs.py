"""What the Drake leaves of a machine are made of: one plan per part, or one for all parts in front of the bus."""

from __future__ import annotations

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.fused import GROUP, outside, plant_machine, plant_tasks, sampled, slot_function, state_size
from exodrake.compiled.leaf_functions import held_signals, outer_reads
from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.core.part import Part, Task
from exodrake.diagrams.leaf import Feedthrough, LeafSpec, PeriodicUpdate


def parameters_of(machine: Machine, part: Part) -> slice:
    """Where a part's numbers lie in the flat vector."""
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
    """The flat state of all parts at the start, for these numbers [SI]."""
    state = np.zeros(state_size(machine))
    compile_machine(machine).begin(values, state)
    return state


def times(machine: Machine, task: Task, substeps: int) -> list[tuple[tuple, float, float]]:
    """(constants, period [s], offset [s]) of the beats of a task.

    A sampled task runs in the middle of its slot, all sub-ticks of the plant in the half slot before it, a log at the
    slot's end: no two of them ever at the same time, where a rounding error would decide which comes first.
    """
    if task.slots:
        return [
            ((k,) if task.per_channel else (), machine.frame, (slot + 0.5) * machine.slot)
            for k, slot in enumerate(task.slots)
        ]
    dt, half = machine.slot / substeps, 0.5 * machine.slot
    return [((dt,), machine.slot, half * (i + 0.5) / substeps) for i in range(substeps)]


def held_at_start(machine: Machine, part: Part, parameters: np.ndarray, state: np.ndarray) -> dict[str, np.ndarray]:
    """Values of the wires that a part holds, for its own state."""
    held = {wire: np.zeros(machine.width(machine.signal[wire].axis)) for wire in held_signals(part)}
    getattr(compile_machine(machine), f"{part.name}__leaf__hold")(state, *held.values(), parameters)
    return held


def part_spec(machine: Machine, part: Part, values: np.ndarray, substeps: int = 1) -> LeafSpec:
    """The plan of one part, with the machine's numbers [SI] and the state in which the whole machine starts."""
    module = compile_machine(machine)
    parameters, state = values[parameters_of(machine, part)], start_state(machine, values)[state_of(machine, part)]
    updates = []
    for task in part.tasks:
        function, reads = getattr(module, f"{part.name}__leaf__{task.function}"), outer_reads(part, task.reads)
        updates += [
            PeriodicUpdate(function, own, reads, period, offset)
            for own, period, offset in times(machine, task, substeps)
        ]
    through = [
        Feedthrough(getattr(module, f"{part.name}__leaf__{o.function}"), o.reads, o.writes)
        for o in part.outputs
        if o.reads
    ]
    widths = {wire.name: machine.width(wire.axis) for wire in machine.signals}
    own = {wire for item in through for wire in item.writes}
    read = dict.fromkeys(wire for item in (*updates, *through) for wire in item.reads if wire not in own)
    inputs = {wire: widths[wire] for wire in read}
    held = held_at_start(machine, part, parameters, state)
    return LeafSpec(part.name, inputs, parameters, state, held, tuple(updates), tuple(through), widths)


def plant_spec(machine: Machine, values: np.ndarray, substeps: int = 1) -> LeafSpec:
    """The plan of all parts in front of the bus as one leaf; its port shows states and wires of `plant_machine`."""
    plant, module = fusible(machine), compile_machine(machine)
    last = plant.parts[-1]
    parameters, size = values[: parameters_of(machine, last).stop], state_size(plant)
    memory = np.zeros(size + sum(machine.width(wire.axis) for wire in plant.signals))
    memory[:size] = start_state(machine, values)[:size]
    getattr(module, f"{GROUP}__leaf__hold")(memory, parameters)
    updates = []
    for slots, tasks in {(): plant_tasks(plant), **sampled(plant)}.items():
        function, reads = getattr(module, f"{GROUP}__leaf__{slot_function(slots)}"), outside(plant, tasks)
        for own, period, offset in times(machine, tasks[0], 1):
            constants = own if slots else (machine.slot / substeps, substeps)
            updates.append(PeriodicUpdate(function, constants, reads, period, offset))
    inputs = {name: machine.width(machine.signal[name].axis) for name in plant.inputs}
    return LeafSpec(GROUP, inputs, parameters, memory, {}, tuple(updates), show="memory")


def fusible(machine: Machine) -> Machine:
    """The group of parts in front of the bus; InputError if this machine has none."""
    plant = plant_machine(machine)
    if plant is None:
        raise InputError(
            f"{machine.name}: the parts that tick with the plant do not stand first, or feed through; cannot fuse them"
        )
    return plant
