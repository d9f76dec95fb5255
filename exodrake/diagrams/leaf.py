"""Turns a part into a Drake system: ports named like wires, numbers as a parameter, one discrete update a task.

What a part is made of arrives as a `Plan` of plain functions and vectors: this file knows Drake, not tables or robots.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from weakref import ref

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteStateIndex, DiscreteValues, LeafSystem


@dataclass(frozen=True)
class PeriodicUpdate:
    """A periodic task: `function(state, held..., numbers, *constants, *reads)`, which changes state and held wires.

    Attributes:
        constants: arguments before the wires, such as the tick's length [s] or the channel's index.
        reads: wires, by the name of an input port or of an output port of direct feedthrough.
        period, offset: when it runs [s].
    """

    function: Callable
    constants: tuple
    reads: tuple[str, ...]
    period: float
    offset: float


@dataclass(frozen=True)
class Feedthrough:
    """Wires of direct feedthrough: `function(state, numbers, *reads, *writes)`, which fills `writes`."""

    function: Callable
    reads: tuple[str, ...]
    writes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class LeafSpec:
    """All that a leaf is made of.

    Attributes:
        name: of the system. inputs: wire -> width.
        numbers: (n,) parameters [SI]. state: (m,) at the start.
        held: wire -> (width,) value at the start, of the wires that follow from the state alone; they are kept as
            discrete state, so that their ports never ask for an input and cost no call.
        through: wires that answer their input at once, with `widths`.
        show: name of a port for the state itself; none if empty.
    """

    name: str
    inputs: dict[str, int]
    parameters: np.ndarray
    state: np.ndarray
    held: dict[str, np.ndarray]
    updates: tuple[PeriodicUpdate, ...]
    through: tuple[Feedthrough, ...] = ()
    widths: dict[str, int] = field(default_factory=dict)
    show: str = ""


class Leaf(LeafSystem):
    """A part as a Drake system. Sampled: no continuous state, no event but its own periodic updates.

    .. pydrake_system::

        name: Leaf
        input_ports:
        - a wire read from another part
        - ...
        output_ports:
        - a wire that the part writes
        - ...

    The ports are the part's wires, by name. Numeric parameter 0 holds the part's numbers, discrete state 0 its state,
    and discrete states 1, 2, ... the wires that it holds. A wire of direct feedthrough is calculated from the inputs
    that it reads, and its port says so.
    """

    def __init__(self, plan: LeafSpec) -> None:
        super().__init__()
        self.set_name(plan.name)
        self.plan = plan
        for wire, width in plan.inputs.items():
            self.DeclareVectorInputPort(wire, width)
        self.DeclareNumericParameter(BasicVector(plan.parameters))
        state = DiscreteStateIndex(int(self.DeclareDiscreteState(plan.state)))
        if plan.show:
            self.DeclareStateOutputPort(plan.show, state)
        for wire, value in plan.held.items():
            self.DeclareStateOutputPort(wire, DiscreteStateIndex(int(self.DeclareDiscreteState(value))))
        for item in plan.through:
            for wire in item.writes:
                self._declare_through(item, wire)
        for update in plan.updates:
            self.DeclarePeriodicDiscreteUpdateEvent(update.period, update.offset, self._update(update))

    def _update(self, task: PeriodicUpdate) -> Callable[[Context, DiscreteValues], None]:
        """The handler of a task. It knows the leaf weakly: Drake holds it, and a circle through C++ is never freed."""
        here, function, constants = ref(self), task.function, task.constants
        if any(wire not in self.plan.inputs for wire in task.reads):
            return self._update_from_own(task)
        ports = tuple(int(self.GetInputPort(wire).get_index()) for wire in task.reads)
        groups = tuple(range(1 + len(self.plan.held)))

        def update(context: Context, discrete: DiscreteValues) -> None:
            read = here().EvalVectorInput  # pyright: ignore[reportOptionalMemberAccess]
            vectors = [discrete.get_mutable_value(i) for i in groups]
            parameters = context.get_numeric_parameter(0).value()
            function(*vectors, parameters, *constants, *[read(context, i).value() for i in ports])

        return update

    def _update_from_own(self, task: PeriodicUpdate) -> Callable[[Context, DiscreteValues], None]:
        """The handler of a task that also reads wires of direct feedthrough of its own leaf."""
        here, inputs, held = ref(self), self.plan.inputs, len(self.plan.held)

        def update(context: Context, discrete: DiscreteValues) -> None:
            leaf = here()
            assert leaf is not None
            reads = [(leaf.GetInputPort if w in inputs else leaf.GetOutputPort)(w).Eval(context) for w in task.reads]
            vectors = [discrete.get_mutable_value(i) for i in range(1 + held)]
            task.function(*vectors, context.get_numeric_parameter(0).value(), *task.constants, *reads)

        return update

    def _declare_through(self, item: Feedthrough, wire: str) -> None:
        """A port of direct feedthrough; other wires of the same function go to scratch memory."""
        here, function, widths = ref(self), item.function, self.plan.widths
        ports = tuple(int(self.GetInputPort(read).get_index()) for read in item.reads)
        scratch = [None if write == wire else np.zeros(widths[write]) for write in item.writes]

        def calculate(context: Context, out: BasicVector) -> None:
            read = here().EvalVectorInput  # pyright: ignore[reportOptionalMemberAccess]
            state, parameters = context.get_discrete_state(0).value(), context.get_numeric_parameter(0).value()
            reads = [read(context, i).value() for i in ports]
            writes = [out.get_mutable_value() if vector is None else vector for vector in scratch]
            function(state, parameters, *reads, *writes)

        needs = {self.input_port_ticket(self.GetInputPort(read).get_index()) for read in item.reads}
        self.DeclareVectorOutputPort(
            wire, widths[wire], calculate, needs | {self.xd_ticket(), self.all_parameters_ticket()}
        )

    def set_part(self, context: Context, plan: LeafSpec) -> None:
        """Puts the numbers, the state and the held wires of a plan for the same part into the leaf's own Context."""
        context.get_mutable_numeric_parameter(0).SetFromVector(plan.parameters)
        for i, vector in enumerate((plan.state, *plan.held.values())):
            context.SetDiscreteState(i, vector)
