"""A part as a Drake system: ports named by signals, named parameters, one discrete update a periodic event.

What the system is made of arrives as a `LeafSpec` of compiled functions and arrays: this module knows Drake alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any
from weakref import ref

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteStateIndex,
    LeafSystem,
    ValueProducer,
)

from exodrake.compiled.events import FIRST_SIGNAL
from exodrake.core.errors import InputError, nearest


@dataclass(frozen=True)
class PeriodicUpdate:
    """A periodic event: `function(table, constant)` leaves the leaf's new memory in the scratch.

    Attributes:
        constant: the tick's length [s], or the channel's index.
        reads: input ports that must be up to date.
        period, offset: when it runs [s].
    """

    function: Callable
    constant: float
    reads: tuple[str, ...]
    period: float
    offset: float


@dataclass(frozen=True)
class Feedthrough:
    """Signals of direct feedthrough: `function(table, 0)` leaves `writes` in the scratch; `reads`: input ports."""

    function: Callable
    reads: tuple[str, ...]
    writes: tuple[str, ...]


@dataclass(frozen=True)
class InputSpec:
    """An input port: its width, the signals in it, and whether it is connected to another leaf for good."""

    width: int
    signals: dict[str, slice]
    connected: bool = False


@dataclass(frozen=True, eq=False)
class LeafSpec:
    """All that a leaf is made of.

    Attributes:
        name: of the system.
        inputs: name of an input port -> what it carries.
        parameters: (n,) array [SI], with `parameter_names`.
        memory: (m,) array at the start: the state, then the signals that follow from the state alone.
        signals: name -> place in the scratch memory: the memory, then the signals of direct feedthrough.
        reads: signals read, in the order of the table of addresses.
    """

    name: str
    inputs: dict[str, InputSpec]
    parameters: np.ndarray
    parameter_names: tuple[str, ...]
    memory: np.ndarray
    signals: dict[str, slice]
    reads: tuple[str, ...]
    updates: tuple[PeriodicUpdate, ...]
    feedthrough: tuple[Feedthrough, ...] = ()
    scratch_size: int = field(default=0)


class Binding:
    """A leaf's table of addresses for one Context.

    It lives in the cache of that Context, dies with it, and is filled again in a copy of the Context. Parameters and
    discrete state of a Context keep their place in memory whenever they are set.
    """

    __slots__ = ("__weakref__", "arrays", "bound", "context", "outputs", "read", "scratch", "table")

    def __init__(self) -> None:
        self.context: Context | None = None

    def __deepcopy__(self, memo: dict) -> Binding:
        return Binding()

    def fill(self, leaf: Leaf, context: Context) -> None:
        """Finds the Context's memory; arrays are kept as long as their addresses."""
        spec = leaf.spec
        self.context, self.read = context, leaf.EvalVectorInput
        memory = context.get_discrete_state(0).value()
        parameters = context.get_numeric_parameter(0).value()
        scratch = np.zeros(spec.scratch_size)
        self.scratch = scratch[: len(spec.memory)]
        self.outputs = {name: scratch[at] for name, at in spec.signals.items()}
        self.bound: list[BasicVector | None] = [None] * len(spec.inputs)
        self.arrays = [memory, parameters, scratch, *(np.zeros(port.width) for port in spec.inputs.values())]
        self.table = np.zeros(FIRST_SIGNAL + len(spec.reads), dtype=np.uint64)
        self.table[:FIRST_SIGNAL] = [array.ctypes.data for array in self.arrays[:FIRST_SIGNAL]]
        for i in range(len(spec.inputs)):
            self.point(spec, i)

    def point(self, spec: LeafSpec, i: int) -> None:
        """Puts the addresses of the signals of input port i into the table."""
        start = self.arrays[FIRST_SIGNAL + i].ctypes.data
        for name, at in list(spec.inputs.values())[i].signals.items():
            self.table[FIRST_SIGNAL + spec.reads.index(name)] = start + 8 * at.start

    def take(self, spec: LeafSpec, i: int, vector: BasicVector) -> None:
        """Input port i has a vector that is not bound: binds it if it stays in place, else copies its values."""
        if list(spec.inputs.values())[i].connected:
            self.arrays[FIRST_SIGNAL + i], self.bound[i] = vector.value(), vector
            self.point(spec, i)
        else:
            self.arrays[FIRST_SIGNAL + i][:] = vector.value()


class Leaf(LeafSystem):
    """A part as a Drake system. Sampled: no continuous state, no event but its own periodic updates.

    .. pydrake_system::

        name: Leaf
        input_ports:
        - a signal read from another part
        - ...
        output_ports:
        - a signal that the part writes
        - ...
        - memory

    Numeric parameter 0 holds the parameters (`parameter_index` finds one by its name), discrete state 0 the memory: the
    part's state, then the signals that follow from it alone. Port `memory` shows it as a whole. A signal of direct
    feedthrough is calculated from the inputs that it reads, and its port says so.

    An input port that `LeafSpec` calls connected is bound to the vector that it is connected to, once for a Context:
    do not fix its value.
    """

    def __init__(self, spec: LeafSpec) -> None:
        super().__init__()
        self.set_name(spec.name)
        self.spec = spec
        for name, port in spec.inputs.items():
            self.DeclareVectorInputPort(name, port.width)
        self.DeclareNumericParameter(BasicVector(spec.parameters))
        memory = DiscreteStateIndex(int(self.DeclareDiscreteState(spec.memory)))
        producer = ValueProducer(allocate=lambda: AbstractValue.Make(Binding()), calc=lambda context, value: None)
        entry = self.DeclareCacheEntry("memory of this Context", producer, {self.nothing_ticket()})
        self._binding = entry.cache_index()  # the entry itself would keep the leaf alive for ever
        self._last: list[Callable[[], Binding | None]] = [lambda: None]  # of the Context used last
        written = {name for item in spec.feedthrough for name in item.writes}
        for name, at in spec.signals.items():
            if name not in written:
                self.DeclareVectorOutputPort(name, at.stop - at.start, slice_of_memory(at), {self.xd_ticket()})
        for item in spec.feedthrough:
            for name in item.writes:
                self._declare_feedthrough(item, name)
        self.DeclareStateOutputPort("memory", memory)
        for update in spec.updates:
            handler = self._handler(update.function, update.constant, update.reads)
            self.DeclarePeriodicDiscreteUpdateEvent(update.period, update.offset, handler)

    def parameter_index(self, name: str) -> int:
        """Index of a parameter in numeric parameter 0 by its full name, `finger.kappa.MCP`.

        Raises:
            InputError: the part has no parameter of that name.
        """
        if name not in self.spec.parameter_names:
            raise InputError(
                f"{self.get_name()} has no parameter {name!r}{nearest(name, list(self.spec.parameter_names))}"
            )
        return self.spec.parameter_names.index(name)

    def set_part(self, context: Context, spec: LeafSpec) -> None:
        """Puts parameters and initial memory of a specification of the same part into the leaf's own Context."""
        context.get_mutable_numeric_parameter(0).SetFromVector(spec.parameters)
        context.SetDiscreteState(0, spec.memory)

    def bind(self, context: Context) -> Binding:
        """The table of addresses of a Context, which becomes the one used last."""
        binding: Any = self.get_cache_entry(self._binding).Eval(context)
        if binding.context is not context:
            binding.fill(self, context)
        self._last[0] = ref(binding)
        return binding

    def _handler(
        self, function: Callable, constant: float, reads: tuple[str, ...], shown: str = ""
    ) -> Callable[[Context, Any], None]:
        """The handler of an event, or of the output port of the signal `shown`.

        It knows the leaf weakly: Drake holds it, and a circle through C++ is never freed.
        """
        here, last, names = ref(self), self._last, list(self.spec.inputs)
        ports = tuple(names.index(name) for name in reads)

        def handler(context: Context, target: Any) -> None:
            binding = last[0]()
            if binding is None or binding.context is not context:
                binding = here().bind(context)  # pyright: ignore[reportOptionalMemberAccess]
            for i in ports:
                vector = binding.read(context, i)
                if vector is not binding.bound[i]:
                    binding.take(here().spec, i, vector)  # pyright: ignore[reportOptionalMemberAccess]
            function(binding.table, constant)
            if shown:
                target.set_value(binding.outputs[shown])
            else:
                target.set_value(0, binding.scratch)

        return handler

    def _declare_feedthrough(self, item: Feedthrough, name: str) -> None:
        """A port of direct feedthrough."""
        needs = {self.input_port_ticket(self.GetInputPort(read).get_index()) for read in item.reads}
        needs |= {self.xd_ticket(), self.all_parameters_ticket()}
        at = self.spec.signals[name]
        calculate = self._handler(item.function, 0, item.reads, name)
        self.DeclareVectorOutputPort(name, at.stop - at.start, calculate, needs)


def slice_of_memory(at: slice) -> Callable[[Context, BasicVector], None]:
    """The function of an output port that shows a part of discrete state 0."""

    def calculate(context: Context, out: BasicVector) -> None:
        out.set_value(context.get_discrete_state(0).value()[at])

    return calculate
