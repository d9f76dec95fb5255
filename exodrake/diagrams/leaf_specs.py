"""What the Drake leaves of a machine are made of: one plan per part, or one for all parts in front of the bus."""

from __future__ import annotations

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.fused import GROUP, outside, plant_machine, plant_tasks, sampled, slot_function, state_size
from exodrake.compiled.leaf_functions import held_wires, outer_reads
from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.core.part import Block, Task
from exodrake.diagrams.leaf import Beat, Plan, Through


def numbers_of(machine: Machine, block: Block) -> slice:
    """Where a part's numbers lie in the flat vector."""
    places = [i for i, entry in enumerate(machine.entries) if entry.block == block.name]
    return slice(places[0], places[-1] + 1) if places else slice(0, 0)


def state_of(machine: Machine, block: Block) -> slice:
    """Where a part's states lie in the flat state."""
    start = 0
    for other in machine.blocks:
        size = sum(machine.part_size(other))
        if other.name == block.name:
            return slice(start, start + size)
        start += size
    raise InputError(f"{machine.name} has no part {block.name!r}")


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
            ((k,) if task.lanes else (), machine.frame, (slot + 0.5) * machine.slot)
            for k, slot in enumerate(task.slots)
        ]
    dt, half = machine.slot / substeps, 0.5 * machine.slot
    return [((dt,), machine.slot, half * (i + 0.5) / substeps) for i in range(substeps)]


def held_at_start(machine: Machine, block: Block, numbers: np.ndarray, state: np.ndarray) -> dict[str, np.ndarray]:
    """Values of the wires that a part holds, for its own state."""
    held = {wire: np.zeros(machine.width(machine.wire[wire].over)) for wire in held_wires(block)}
    getattr(compile_machine(machine), f"{block.name}__leaf__hold")(state, *held.values(), numbers)
    return held


def part_plan(machine: Machine, block: Block, values: np.ndarray, substeps: int = 1) -> Plan:
    """The plan of one part, with the machine's numbers [SI] and the state in which the whole machine starts."""
    module = compile_machine(machine)
    numbers, state = values[numbers_of(machine, block)], start_state(machine, values)[state_of(machine, block)]
    beats = []
    for task in block.tasks:
        function, reads = getattr(module, f"{block.name}__leaf__{task.function}"), outer_reads(block, task.reads)
        beats += [Beat(function, own, reads, period, offset) for own, period, offset in times(machine, task, substeps)]
    through = [
        Through(getattr(module, f"{block.name}__leaf__{o.function}"), o.reads, o.writes)
        for o in block.outputs
        if o.reads
    ]
    widths = {wire.name: machine.width(wire.over) for wire in machine.wires}
    own = {wire for item in through for wire in item.writes}
    read = dict.fromkeys(wire for item in (*beats, *through) for wire in item.reads if wire not in own)
    inputs = {wire: widths[wire] for wire in read}
    held = held_at_start(machine, block, numbers, state)
    return Plan(block.name, inputs, numbers, state, held, tuple(beats), tuple(through), widths)


def plant_plan(machine: Machine, values: np.ndarray, substeps: int = 1) -> Plan:
    """The plan of all parts in front of the bus as one leaf; its port shows states and wires of `plant_machine`."""
    plant, module = fusible(machine), compile_machine(machine)
    last = plant.blocks[-1]
    numbers, size = values[: numbers_of(machine, last).stop], state_size(plant)
    memory = np.zeros(size + sum(machine.width(wire.over) for wire in plant.wires))
    memory[:size] = start_state(machine, values)[:size]
    getattr(module, f"{GROUP}__leaf__hold")(memory, numbers)
    beats = []
    for slots, tasks in {(): plant_tasks(plant), **sampled(plant)}.items():
        function, reads = getattr(module, f"{GROUP}__leaf__{slot_function(slots)}"), outside(plant, tasks)
        for own, period, offset in times(machine, tasks[0], 1):
            constants = own if slots else (machine.slot / substeps, substeps)
            beats.append(Beat(function, constants, reads, period, offset))
    inputs = {name: machine.width(machine.wire[name].over) for name in plant.given}
    return Plan(GROUP, inputs, numbers, memory, {}, tuple(beats), show="memory")


def fusible(machine: Machine) -> Machine:
    """The group of parts in front of the bus; InputError if this machine has none."""
    plant = plant_machine(machine)
    if plant is None:
        raise InputError(
            f"{machine.name}: the parts that tick with the plant do not stand first, or feed through; cannot fuse them"
        )
    return plant
