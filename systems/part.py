"""What the systems of a robot's parts share: their equations, their parameters by name, and where they start."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any
from weakref import ref

import numpy as np
from pydrake.common import RandomGenerator
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem, ValueProducer

from exodrake.compiled.compose import equations
from exodrake.compiled.schedule import start_vectors
from exodrake.core.errors import InputError, nearest
from exodrake.core.machine import Machine, channels_of
from exodrake.core.part import Part
from exodrake.core.robot import Robot, drawn_deviation
from exodrake.machines.robot_file import robot_or_default


@dataclass(frozen=True, repr=False)
class NamedParameter:
    """A parameter, or all channels of one, in the Contexts of a leaf.

    Attributes:
        leaf: that holds it.
        name: as in robot files.
        index: place of each channel in a numeric parameter of the leaf.
        group: which numeric parameter that is.
        in_effect: all values of the leaf with their deviations, from its own Context; None: there are no deviations.

    Contexts may be the leaf's own or those of the whole Diagram. The run begins from a changed parameter if it is
    changed before `Simulator.Initialize`.
    """

    leaf: LeafSystem
    name: str
    index: tuple[int, ...]
    group: int = 0
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


def named_parameter(leaf: Any, name: str, names: tuple[str, ...]) -> NamedParameter:
    """A parameter among the `names` of a leaf. InputError if there is none."""
    index = channels_of(name, names)
    if not index:
        raise InputError(f"{leaf.get_name()} has no parameter {name!r}{nearest(name, list(names))}")
    return NamedParameter(leaf, name, tuple(index), in_effect=leaf.p)


class PartSystem(LeafSystem):
    """A LeafSystem with the equations, the parameters and the discrete state of one part of a robot.

    A subclass declares ports and events, and calls `self.equations`: the functions of the part's module in
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

    options: tuple = ()  # further arguments of a subclass, for `Clone`

    def __init__(self, robot: Robot | None, name: str) -> None:
        super().__init__()
        self.set_name(name)
        self.robot = robot_or_default(robot)
        self.machine, self.part = self.robot.machine, part_named(self.robot.machine, name)
        self.equations = equations(self.machine, self.part)
        own = [i for i, parameter in enumerate(self.machine.parameters) if parameter.part == name]
        self.own = slice(own[0], own[-1] + 1) if own else slice(0, 0)
        self.parameter_names = tuple(parameter.name for parameter in self.machine.parameters[self.own])
        self.starts = start_arrays(self.robot)
        self.initial = np.zeros(sum(self.machine.part_size(self.part)))
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

    def p(self, context: Context) -> np.ndarray:
        """Parameters in effect in a Context of the leaf, deviation included, (n,) [SI]; not to be written to."""
        found: Any = self.get_cache_entry(self._parameters).Eval(context)
        return found

    def x(self, context: Context) -> np.ndarray:
        """State of a Context of the leaf; not to be written to."""
        return context.get_discrete_state(0).value()

    def parameter(self, name: str) -> NamedParameter:
        """A parameter by its full name, `finger.kappa.MCP`, or all channels of one, `finger.kappa`.

        Raises:
            InputError: the part has no parameter of that name.
        """
        return named_parameter(self, name, self.parameter_names)

    def begin(self, context: Context, discrete: DiscreteValues) -> None:
        """The initialization: a state that is still the default one begins from the Context's parameters."""
        x = discrete.get_mutable_value(0)
        if np.array_equal(x, self.initial):
            self.equations.start(x, self.p(context), *self.start_vectors(context))

    def start_vectors(self, context: Context | None) -> list[np.ndarray]:
        """What the part's `start` reads or fills: from the input port of that name, else as the robot starts."""
        return [
            np.array(self.GetInputPort(name).Eval(context))
            if context and self.HasInputPort(name) and self.GetInputPort(name).HasValue(context)
            else np.array(self.starts.get(name, np.zeros(len(self.machine.axes.tendons))))
            for name in start_vectors(self.part)
        ]

    def ticks(self, substeps: int) -> list[tuple[float, float]]:
        """(period, offset) [s] of the ticks of the plant: in the first half of each slot, before the tasks."""
        slot = self.machine.slot
        return [(slot, 0.5 * slot * (k + 0.5) / substeps) for k in range(substeps)]

    def moment(self, slot: int) -> float:
        """When a task of a slot runs: in its middle [s] after the start of the frame."""
        return (slot + 0.5) * self.machine.slot

    def Clone(self) -> PartSystem:
        """A leaf like this one."""
        return type(self)(self.robot, *self.options)

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


def part_named(machine: Machine, name: str) -> Part:
    """A part of a machine. InputError with the nearest names."""
    parts = {part.name: part for part in machine.parts}
    if name not in parts:
        raise InputError(f"{machine.name} has no part {name!r}{nearest(name, list(parts))}")
    return parts[name]


def start_arrays(robot: Robot) -> dict[str, np.ndarray]:
    """The start vectors (tendons,) of the robot's machine [SI], from the parts that fill them."""
    machine, found = robot.machine, {}
    for part in (part for part in machine.parts if part.fills_start):
        values = np.array([robot[p.name] for p in machine.parameters if p.part == part.name])
        vectors = {name: np.zeros(len(machine.axes.tendons)) for name in start_vectors(part)}
        equations(machine, part).start(np.zeros(sum(machine.part_size(part))), values, *vectors.values())
        found |= vectors
    return found
