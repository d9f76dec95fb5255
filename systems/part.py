"""A part of a robot as a Drake system: equations, parameters by name and start, and a generic leaf for any part."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any
from weakref import ref

import numpy as np
from pydrake.common import RandomGenerator
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem, System, ValueProducer

from exodrake.core.errors import InputError, nearest
from exodrake.engine.compose import equations
from exodrake.engine.schedule import start_vectors
from exodrake.machines.robot_file import robot_or_default
from exodrake.model.machine import find_places
from exodrake.model.part import NORMAL, Task
from exodrake.model.robot import Robot, drawn_deviation


@dataclass(frozen=True, repr=False)
class NamedParameter:
    """A parameter, or all channels of one, in the Contexts of a leaf.

    Contexts may be the leaf's own or those of the whole Diagram. The run begins from a changed parameter if it is
    changed before `Simulator.Initialize`.
    """

    leaf: LeafSystem  # that holds it
    name: str  # as in robot files
    index: tuple[int, ...]  # place of each channel in a numeric parameter of the leaf
    group: int = 0  # which numeric parameter that is
    # all values of the leaf with their deviations, from its own Context; None: there are no deviations
    in_effect: Callable[[Context], np.ndarray] | None = None

    def __repr__(self) -> str:
        return f"NamedParameter({self.name}: {len(self.index)} of {self.leaf.get_name()})"

    def get(self, context: Context) -> np.ndarray:
        """Values (channels,) [SI], the deviation of a robot drawn at random included."""
        own = self._own(context)
        values = self.in_effect(own) if self.in_effect else own.get_numeric_parameter(self.group).value()
        return np.array(values)[list(self.index)]

    def set(self, context: Context, value: float | np.ndarray) -> None:
        """Sets one value for all channels, or an array (channels,) [SI]."""
        own, index = self._own(context), list(self.index)
        values, in_effect = np.array(own.get_numeric_parameter(self.group).value()), self.get(context)
        deviation = np.subtract(in_effect, values[index], out=np.zeros(len(index)), where=in_effect != values[index])
        values[index] = value - deviation
        own.get_mutable_numeric_parameter(self.group).SetFromVector(values)

    def _own(self, context: Context) -> Context:
        """The leaf's own Context."""
        try:
            self.leaf.ValidateContext(context)
        except RuntimeError:
            return self.leaf.GetMyMutableContextFromRoot(context)
        return context


def array_parameter(leaf: LeafSystem, name: str, sizes: Mapping[str, int]) -> NamedParameter:
    """All values of one of a leaf's numeric parameters, whose lengths are `sizes`. InputError for another name."""
    names = list(sizes)
    if name not in names:
        raise InputError(f"{leaf.get_name()} has no parameter {name!r}{nearest(name, names)}")
    return NamedParameter(leaf, name, tuple(range(sizes[name])), names.index(name))


class Cloneable:
    """Lets a system clone itself, by its constructor from the same arguments; systems among them are cloned, too.

    Drake's own `Clone` asks for scalar conversion, which equations that numba compiles do not have.
    """

    def __new__(cls, *arguments: Any, **named: Any) -> Any:
        """An instance that knows its arguments."""
        self: Any = super().__new__(cls)
        self.arguments, self.named = arguments, named
        return self

    def Clone(self: Any) -> Any:
        """A system like this one."""

        def copy(value: Any) -> Any:
            if isinstance(value, list):
                return [copy(one) for one in value]
            return value.Clone() if isinstance(value, System) else value

        clone = type(self)(*map(copy, self.arguments), **{name: copy(value) for name, value in self.named.items()})
        clone.set_name(self.get_name())
        return clone


class PartSystem(Cloneable, LeafSystem):
    """A LeafSystem with the equations, the parameters and the discrete state of one part of a robot.

    A subclass declares ports and events, and its updates call `self.equations`: the functions of the part's module in
    `exodrake.physics`, effects included, which the compiled simulator runs too. Arguments are the state x, the
    parameters p, and signals. They write in place.

    Numeric parameter 0 holds the parameters of part and effects [SI], found by name: `motor.parameter("motor.r.AF")`.
    Input port `deviation`, of the same length, is added to them; unconnected it counts as 0. It carries the tolerances
    of a robot drawn at random. Discrete state 0 is the state of the part, then that of its effects.

    At initialization, a state that nobody has set begins anew from the parameters of the Context.

    Args:
        robot: the robot; None: the nominal Exo-Index.
        name: of the part.

    Raises:
        InputError: the robot has no such part.
    """

    def __init__(self, robot: Robot | None, name: str) -> None:
        super().__init__()
        self.set_name(name)
        self.robot = robot_or_default(robot)
        self.machine = machine = self.robot.machine
        parts = {part.name: part for part in machine.parts}
        if name not in parts:
            raise InputError(f"{machine.name} has no part {name!r}{nearest(name, list(parts))}")
        self.part = parts[name]
        self.equations = equations(machine, self.part)
        self.writer = {signal: output for output in self.part.outputs for signal in output.writes}
        own = [i for i, parameter in enumerate(machine.parameters) if parameter.part == name]
        self.own = slice(own[0], own[-1] + 1) if own else slice(0, 0)
        self.parameter_names = tuple(parameter.name for parameter in machine.parameters[self.own])
        self.starts: dict[str, np.ndarray] = {}  # the start vectors (tendons,) [SI] of the robot as it is
        for part in (part for part in machine.parts if part.fills_start):
            values = np.array([self.robot[p.name] for p in machine.parameters if p.part == part.name])
            vectors = {vector: np.zeros(len(machine.axes.tendons)) for vector in start_vectors(part)}
            equations(machine, part).start(np.zeros(sum(machine.part_sizes[part.name])), values, *vectors.values())
            self.starts |= vectors
        self.initial = np.zeros(sum(machine.part_sizes[name]))
        values = np.array(self.robot.values[self.own])
        self.equations.start(self.initial, values, *self.start_vectors(None))

        self.DeclareNumericParameter(BasicVector(values))
        self.DeclareDiscreteState(self.initial)
        self.deviation = self.DeclareVectorInputPort("deviation", len(own))
        changed = {self.all_parameters_ticket(), self.input_port_ticket(self.deviation.get_index())}
        here: Any = ref(self)  # a cache entry keeps what it refers to alive for ever
        producer = ValueProducer(
            allocate=lambda: AbstractValue.Make(np.array(values)), calc=lambda *both: here()._deviated(*both)
        )
        entry = self.DeclareCacheEntry("parameters with their deviations", producer, changed)
        self._parameters, self.parameters_ticket = entry.cache_index(), entry.ticket()
        self.DeclareInitializationDiscreteUpdateEvent(self.begin)

    def declare_outputs(self, *signals: str) -> None:
        """Declares an output port for each signal, computed by the part's output function from state and signals."""
        for signal in signals:
            needs = {self.xd_ticket(), self.parameters_ticket}
            needs |= {self.input_port_ticket(self.GetInputPort(s).get_index()) for s in self.outer_reads(signal)}
            self.DeclareVectorOutputPort(signal, len(self.machine.channels(signal)), partial(self.show, signal), needs)

    def show(self, signal: str, context: Context, output: BasicVector) -> None:
        """Fills the output port of a signal."""
        output.set_value(self.signal(context, signal))

    def signal(self, context: Context, name: str) -> np.ndarray:
        """A signal that the part writes, or reads at a port, (channels,) [SI]; unconnected noise counts as none."""
        output = self.writer.get(name)
        if output and output.states:
            at = self.machine.state_index(self.part, output.states[output.writes.index(name)])
            return np.array(self.x(context)[at : at + len(self.machine.channels(name))])
        if output:
            found = [np.zeros(len(self.machine.channels(signal))) for signal in output.writes]
            given = [self.signal(context, signal) for signal in output.reads]
            getattr(self.equations, output.function)(self.x(context), self.p(context), *given, *found)
            return found[output.writes.index(name)]
        port: Any = self.GetInputPort(name)
        kind = self.machine.signal[name].distribution
        if kind and not port.HasValue(context):
            return np.zeros(port.size()) if kind == NORMAL else np.ones(port.size())
        return port.Eval(context)

    def outer_reads(self, signal: str) -> set[str]:
        """Input ports on which a signal depends at once."""
        if signal not in self.writer:
            return {signal}
        return set().union(*(self.outer_reads(name) for name in self.writer[signal].reads))

    def p(self, context: Context) -> np.ndarray:
        """Parameters in effect in a Context of the leaf, deviation included, (n,) [SI]; not to be written to."""
        found: Any = self.get_cache_entry(self._parameters).Eval(context)
        return found

    def x(self, context: Context) -> np.ndarray:
        """State (n,) of a Context of the leaf [units of its states]; not to be written to."""
        return context.get_discrete_state(0).value()

    def parameter(self, name: str) -> NamedParameter:
        """A parameter by its full name, `finger.kappa.MCP`, or all channels of one, `finger.kappa`.

        Raises:
            InputError: the part has no parameter of that name.
        """
        index = find_places(name, self.parameter_names)
        if not index:
            known = list(self.parameter_names)
            raise InputError(f"{self.get_name()} has no parameter {name!r}{nearest(name, known)}")
        return NamedParameter(self, name, tuple(index), in_effect=self.p)

    def begin(self, context: Context, discrete: DiscreteValues) -> None:
        """The initialization: a state that is still the default one begins from the Context's parameters."""
        x = discrete.get_mutable_value(0)
        if np.array_equal(x, self.initial):
            self.equations.start(x, self.p(context), *self.start_vectors(context))

    def start_vectors(self, context: Context | None) -> list[np.ndarray]:
        """What the part's `start` reads or fills, (channels,) each [SI].

        From the input port of that name, else as the robot starts.
        """
        return [
            np.array(self.GetInputPort(name).Eval(context))
            if context and self.HasInputPort(name) and self.GetInputPort(name).HasValue(context)
            else np.array(self.starts.get(name, np.zeros(len(self.machine.axes.tendons))))
            for name in start_vectors(self.part)
        ]

    def show_start(self, row: int, context: Context, output: BasicVector) -> None:
        """Fills the output port of a start vector, which follows from the parameters alone."""
        vectors = self.start_vectors(None)
        self.equations.start(np.array(self.initial), self.p(context), *vectors)
        output.set_value(vectors[row])

    def ticks(self, substeps: int) -> list[tuple[float, float]]:
        """(period, offset) [s] of the ticks of the plant: in the first half of each slot, before the tasks."""
        slot = self.machine.slot
        return [(slot, 0.5 * slot * (k + 0.5) / substeps) for k in range(substeps)]

    def moment(self, slot: int) -> float:
        """When a task of a slot runs: in its middle [s] after the start of the frame."""
        return (slot + 0.5) * self.machine.slot

    def SetRandomContext(self, context: Context, generator: RandomGenerator) -> None:
        """Draws the parameters of a leaf's own Context within their tolerances, with the default state."""
        super().SetRandomContext(context, generator)
        self.deviation.FixValue(context, drawn_deviation(self.robot, np.random.default_rng(generator()))[self.own])

    def _deviated(self, context: Any, value: Any) -> None:
        """Fills the cache entry of the parameters."""
        values = value.get_mutable_value()
        values[:] = context.get_numeric_parameter(0).value()
        if self.deviation.HasValue(context):
            values += self.deviation.Eval(context)


class MachinePart(PartSystem):
    """A part of a machine that has no class of its own: a port for each signal, an event for each slot and tick.

    .. pydrake_system::

        name: MachinePart
        input_ports: [deviation, a signal read from another part, ..., a start vector that another part fills]
        output_ports: [a signal that the part writes, ...]

    Unconnected noise counts as none. State: that of the part in the order of its `PART`, then memories of effects.

    Examples:
        >>> import exodrake as exo
        >>> from pydrake.systems.analysis import Simulator
        >>> scale = exo.MachinePart(exo.load_robot("emps"), "scale")
        >>> simulator = Simulator(scale)
        >>> _ = scale.GetInputPort("position").FixValue(simulator.get_mutable_context(), [0.1])
        >>> _ = simulator.AdvanceTo(0.1)
        >>> print(scale.GetOutputPort("position_read").Eval(simulator.get_context()).round(3))
        [0.1]
    """

    def __init__(self, robot: Robot | None, name: str, substeps: int = 1) -> None:
        """Takes the robot, the name of the part, and plant ticks per slot."""
        super().__init__(robot, name)
        part, tendons = self.part, len(self.machine.axes.tendons)
        for signal in dict.fromkeys(s for item in (*part.tasks, *part.outputs) for s in item.reads):
            if signal not in self.writer:
                self.DeclareVectorInputPort(signal, len(self.machine.channels(signal)))
        for vector in () if part.fills_start else start_vectors(part):
            self.DeclareVectorInputPort(vector, tendons)
        self.declare_outputs(*self.writer)
        for row, vector in enumerate(start_vectors(part) if part.fills_start else ()):
            self.DeclareVectorOutputPort(vector, tendons, partial(self.show_start, row), {self.parameters_ticket})
        together: dict[tuple[int, ...], list[Task]] = {}  # tasks at the tick, or in the same slots
        for task in part.tasks:
            together.setdefault(task.slots, []).append(task)
        for slots, tasks in together.items():
            events = [((self.machine.slot / substeps,), *when) for when in self.ticks(substeps)]
            if slots:
                channels = [(k,) if tasks[0].per_channel else () for k in range(len(slots))]
                moments = [self.moment(slot) for slot in slots]
                events = [(channel, self.machine.frame, moment) for channel, moment in zip(channels, moments)]
            for arguments, period, offset in events:
                self.DeclarePeriodicDiscreteUpdateEvent(period, offset, partial(self.update, tasks, arguments))

    def update(self, tasks: Sequence[Task], arguments: tuple, context: Context, discrete: DiscreteValues) -> None:
        """Tasks of one slot, or of the tick; each sees the signals from before it."""
        x, p = discrete.get_mutable_value(0), self.p(context)
        given = [[self.signal(context, signal) for signal in task.reads] for task in tasks]
        for task, signals in zip(tasks, given):
            getattr(self.equations, task.function)(x, p, *arguments, *signals)
