"""A part of any machine as a Drake system; ports and events follow from the part's declaration."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues

from exodrake.compiled.schedule import start_vectors
from exodrake.core.part import NORMAL, Output, Part, Task
from exodrake.core.robot import Robot
from exodrake.systems.part import PartSystem


class MachinePart(PartSystem):
    """A part of a machine that has no class of its own: a port for each signal, an event for each slot and tick.

    .. pydrake_system::

        name: MachinePart
        input_ports:
        - deviation
        - a signal read from another part
        - ...
        - a start vector that another part fills
        output_ports:
        - a signal that the part writes
        - ...

    Unconnected noise counts as none. State: that of the part in the order of its `PART`, then memories of effects.

    Example:
        scale = MachinePart(load_robot("emps"), "scale")
        simulator = Simulator(scale)
        scale.GetInputPort("position").FixValue(simulator.get_mutable_context(), [0.1])
        simulator.AdvanceTo(0.1)
        print(scale.GetOutputPort("position_read").Eval(simulator.get_context()))
    """

    def __init__(self, robot: Robot | None, name: str, substeps: int = 1) -> None:
        """Takes the robot, the name of the part, and plant ticks per slot."""
        super().__init__(robot, name)
        self.options, part = (name, substeps), self.part
        self.writer = {signal: output for output in part.outputs for signal in output.writes}
        for signal in dict.fromkeys(s for item in (*part.tasks, *part.outputs) for s in item.reads):
            if signal not in self.writer:
                self.DeclareVectorInputPort(signal, len(self.machine.channels(signal)))
        tendons = len(self.machine.axes.tendons)
        for vector in start_reads(part):
            self.DeclareVectorInputPort(vector, tendons)
        for output in part.outputs:
            needs = {self.xd_ticket(), self.parameters_ticket, *map(self.port_ticket, self.read_from_outside(output))}
            for row, signal in enumerate(output.writes):
                width = len(self.machine.channels(signal))
                self.DeclareVectorOutputPort(signal, width, partial(self.show, output, row), needs)
        for row, vector in enumerate(start_vectors(part) if part.fills_start else ()):
            self.DeclareVectorOutputPort(vector, tendons, partial(self.show_start, row), {self.parameters_ticket})
        for tasks in tasks_by_slots(part):
            for arguments, period, offset in self.times(tasks[0], substeps):
                self.DeclarePeriodicDiscreteUpdateEvent(period, offset, partial(self.update, tasks, arguments))

    def times(self, task: Task, substeps: int) -> list[tuple[tuple, float, float]]:
        """Arguments before the signals, period and offset [s] of each event of a task."""
        if not task.slots:
            return [((self.machine.slot / substeps,), *when) for when in self.ticks(substeps)]
        frame = self.machine.frame
        return [((k,) if task.per_channel else (), frame, self.moment(slot)) for k, slot in enumerate(task.slots)]

    def update(self, tasks: Sequence[Task], arguments: tuple, context: Context, discrete: DiscreteValues) -> None:
        """Tasks of one slot, or of the tick; each sees the signals from before it."""
        x, p = discrete.get_mutable_value(0), self.p(context)
        given = [[self.signal(context, signal) for signal in task.reads] for task in tasks]
        for task, signals in zip(tasks, given):
            getattr(self.equations, task.function)(x, p, *arguments, *signals)

    def show(self, output: Output, row: int, context: Context, out: BasicVector) -> None:
        """Fills the output port of a signal."""
        out.set_value(self.written(context, output)[row])

    def show_start(self, row: int, context: Context, out: BasicVector) -> None:
        """Fills the output port of a start vector."""
        vectors = self.start_vectors(None)
        self.equations.start(np.array(self.initial), self.p(context), *vectors)
        out.set_value(vectors[row])

    def written(self, context: Context, output: Output) -> list[np.ndarray]:
        """Signals that an output function writes, (channels,) each [SI]."""
        found = [np.zeros(len(self.machine.channels(signal))) for signal in output.writes]
        given = [self.signal(context, signal) for signal in output.reads]
        getattr(self.equations, output.function)(self.x(context), self.p(context), *given, *found)
        return found

    def signal(self, context: Context, name: str) -> np.ndarray:
        """A signal that the part reads, (channels,) [SI]: of its own, or from an input port."""
        if name in self.writer:
            return self.written(context, self.writer[name])[self.writer[name].writes.index(name)]
        port: Any = self.GetInputPort(name)
        kind = self.machine.signal[name].distribution
        if kind and not port.HasValue(context):
            return np.zeros(port.size()) if kind == NORMAL else np.ones(port.size())
        return port.Eval(context)

    def read_from_outside(self, output: Output) -> set[str]:
        """Input ports on which an output depends at once."""
        own = (self.read_from_outside(self.writer[name]) for name in output.reads if name in self.writer)
        return {name for name in output.reads if name not in self.writer}.union(*own)

    def port_ticket(self, name: str):
        """Ticket of an input port."""
        return self.input_port_ticket(self.GetInputPort(name).get_index())


def tasks_by_slots(part: Part) -> list[list[Task]]:
    """Tasks that run together: at the tick, or in the same slots."""
    found: dict[tuple[int, ...], list[Task]] = {}
    for task in part.tasks:
        found.setdefault(task.slots, []).append(task)
    return list(found.values())


def start_reads(part: Part) -> list[str]:
    """Start vectors that a part's `start` uses, and another part fills."""
    tree = ast.parse(inspect.getsource(part.module.start))
    used = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    return [] if part.fills_start else [name for name in start_vectors(part) if name in used]
