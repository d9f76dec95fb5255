"""A part as a Drake system: ports named by signals, named parameters, one discrete update a periodic event.

What the system is made of arrives as a `LeafSpec` of compiled functions and arrays: this module knows Drake alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import ref

from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from exodrake.diagrams.binding import (
    Binding,
    declare_inputs,
    declare_memory_port,
    declare_per_context,
    note_own,
    weak_method,
)
from exodrake.diagrams.leaf_spec import Feedthrough, LeafSpec
from exodrake.diagrams.parameter import NamedParameter, named_parameter


class Leaf(LeafSystem):
    """A part as a Drake system. Sampled: no continuous state, periodic updates of its own and an initialization.

    .. pydrake_system::

        name: Leaf
        input_ports:
        - a signal read from another part
        - ...
        - a start vector that another part fills
        output_ports:
        - a signal that the part writes
        - ...
        - memory

    Numeric parameter 0 holds the parameters (`parameter` finds one by its name), discrete state 0 the memory: the
    part's state, then the signals that follow from it alone. Port `memory` says where it lies (see `binding`). A signal
    of direct feedthrough is calculated from the inputs that it reads, and its port says so.

    At initialization, a Context at time 0 whose state nobody has set begins anew from its parameters, as a leaf built
    with them would; in any other, the signals that follow from the state are calculated again.
    """

    def __init__(self, spec: LeafSpec) -> None:
        super().__init__()
        self.set_name(spec.name)
        self.spec = spec
        declare_inputs(self, spec.inputs)
        self.DeclareNumericParameter(BasicVector(spec.parameters))
        self.DeclareDiscreteState(spec.memory)
        self._binding = declare_per_context(self, Binding)
        self._last: list[Callable[[], Binding | None]] = [lambda: None]  # of the Context used last
        computed = {name for item in spec.computed for name in item.writes}
        for name, at in spec.signals.items():
            if name not in computed:
                self.DeclareVectorOutputPort(name, at.stop - at.start, slice_of_memory(at), {self.xd_ticket()})
        for item in spec.computed:
            self._declare_computed(item)
        declare_memory_port(self)
        for update in spec.updates:
            handler = self._handler(update.function, update.constant, update.reads)
            self.DeclarePeriodicDiscreteUpdateEvent(update.period, update.offset, handler)
        self.DeclareInitializationDiscreteUpdateEvent(weak_method(self._initialize))

    def parameter(self, name: str) -> NamedParameter:
        """A parameter by its full name, `finger.kappa.MCP`, or all channels of one, `finger.kappa`.

        Raises:
            InputError: the part has no parameter of that name.
        """
        return named_parameter(self, name, self.spec.parameter_names)

    def bind(self, context: Context) -> Binding:
        """The table of addresses of a Context, which becomes the one used last."""
        binding: Any = self.get_cache_entry(self._binding).Eval(context)
        if binding.context is not context:
            binding.fill(self, context)
        self._last[0] = ref(binding)
        return binding

    def _initialize(self, context: Context, target: DiscreteValues) -> None:
        """The initialization: see the class."""
        binding, spec = self.bind(context), self.spec
        memory = context.get_discrete_state(0).value()
        if context.get_time() == 0.0 and memory.tobytes() in (spec.memory.tobytes(), binding.started):
            for i, name in enumerate(spec.inputs):
                if name in spec.start_vectors and self.get_input_port(i).HasValue(context):
                    binding.take(spec, i, self.EvalVectorInput(context, i))
            spec.start(binding.table, 0)
            binding.started = binding.scratch.tobytes()
        else:
            spec.hold(binding.table, 0)
        target.set_value(0, binding.scratch)

    def _handler(
        self, function: Callable, constant: float, reads: tuple[str, ...], shown: str = ""
    ) -> Callable[[Context, Any], None]:
        """The handler of an event, or of the output port `shown`.

        It knows the leaf weakly, as `weak_method` does. States among its inputs are bound, and need no look.
        """
        here, last, names = ref(self), self._last, list(self.spec.inputs)
        inputs = self.spec.inputs
        ports = tuple(names.index(name) for name in reads if not inputs[name].state and inputs[name].signals)

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
                if binding.shown.get(shown) is not target:
                    binding.shown[shown] = note_own(target)
            else:
                target.set_value(0, binding.scratch)

        return handler

    def _declare_computed(self, item: Feedthrough) -> None:
        """Ports of direct feedthrough, or of a start vector."""
        needs = {self.input_port_ticket(self.GetInputPort(read).get_index()) for read in item.reads}
        needs |= {self.xd_ticket(), self.all_parameters_ticket()} if item.reads else {self.all_parameters_ticket()}
        for port, (first, last) in item.ports.items():
            width = self.spec.signals[last].stop - self.spec.signals[first].start
            self.DeclareVectorOutputPort(port, width, self._handler(item.function, 0, item.reads, port), needs)


def slice_of_memory(at: slice) -> Callable[[Context, BasicVector], None]:
    """The function of an output port that shows a part of discrete state 0."""

    def calculate(context: Context, out: BasicVector) -> None:
        out.set_value(context.get_discrete_state(0).value()[at])

    return calculate
