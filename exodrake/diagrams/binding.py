"""Addresses that a leaf looks up once for a Context: its own memory, and the states of others that it reads.

A state output port of Drake's shows a copy, made anew after each change. The port `memory` of our systems says instead
where the state lies, and is found once.

Vectors at other ports are bound to their address as long as they are the same object, which says something of our own
output ports alone, whose vectors live as long as their Context. `FixValue` frees the vector that was fixed before, and
pydrake takes a new one at its address for the old one: such a vector is copied at each reading.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any
from weakref import ref

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, ValueProducer

from exodrake.compiled.events import FIRST_SIGNAL
from exodrake.diagrams.leaf_spec import InputSpec, LeafSpec


class Memory:
    """Where discrete state 0 of a system lies in a Context: the value at its port `memory`."""

    array: np.ndarray

    def __deepcopy__(self, memo: dict) -> Memory:
        return Memory()


def declare_memory_port(system: LeafSystem) -> None:
    """Declares the output port `memory`; nothing is cached, since a copied Context has another memory."""

    def find(context: Any, value: Any) -> None:
        value.get_mutable_value().array = context.get_discrete_state(0).value()

    port: Any = system.DeclareAbstractOutputPort("memory", make_memory, find, {system.nothing_ticket()})
    port.disable_caching_by_default()


def make_memory() -> AbstractValue:
    """An empty value for the port `memory`."""
    return AbstractValue.Make(Memory())


def declare_inputs(system: LeafSystem, inputs: Mapping[str, InputSpec]) -> None:
    """Declares input ports: for states those of their memory, else vectors."""
    for name, port in inputs.items():
        if port.state:
            system.DeclareAbstractInputPort(name, make_memory())
        else:
            system.DeclareVectorInputPort(name, port.width)


OWN: dict[int, ref] = {}  # vectors of our own output ports by their `id`


def note_own(vector: BasicVector) -> BasicVector:
    """Notes the vector of an output port, to be held by an object that lives in the same Context."""
    key = id(vector)
    OWN[key] = ref(vector, lambda _, pop=OWN.pop: pop(key, None))
    return vector


class Binding:
    """A leaf's table of addresses for one Context.

    It lives in the cache of that Context, dies with it, and is filled again in a copy of the Context. Parameters and
    discrete state of a Context keep their place in memory whenever they are set.
    """

    __slots__ = ("__weakref__", "arrays", "bound", "context", "outputs", "read", "scratch", "shown", "started", "table")

    def __init__(self, started: bytes = b"") -> None:
        self.context: Context | None = None
        self.started = started  # memory with which this Context began last
        self.shown: dict[str, BasicVector] = {}  # port -> its vector, see `note_own`

    def __deepcopy__(self, memo: dict) -> Binding:
        return Binding(self.started)

    def fill(self, leaf: Any, context: Context) -> None:
        """Finds the Context's memory and the states behind its inputs; arrays are kept as long as their addresses."""
        spec = leaf.spec
        self.context, self.read = context, leaf.EvalVectorInput
        memory = context.get_discrete_state(0).value()
        parameters = context.get_numeric_parameter(0).value()
        scratch = np.zeros(spec.scratch_size)
        self.scratch = scratch[: len(spec.memory)]
        self.outputs = {
            port: scratch[spec.signals[first].start : spec.signals[last].stop]
            for item in spec.computed
            for port, (first, last) in item.ports.items()
        }
        self.bound: list[BasicVector | None] = [None] * len(spec.inputs)
        self.arrays = [memory, parameters, scratch]
        self.arrays += [np.array(spec.start_vectors.get(name, np.zeros(p.width))) for name, p in spec.inputs.items()]
        self.table = np.zeros(FIRST_SIGNAL + len(spec.reads), dtype=np.uint64)
        self.table[:FIRST_SIGNAL] = [array.ctypes.data for array in self.arrays[:FIRST_SIGNAL]]
        for i, port in enumerate(spec.inputs.values()):
            self.place(spec, i, self.arrays[FIRST_SIGNAL + i])
            if port.state:
                self.place(spec, i, leaf.get_input_port(i).Eval(context).array)

    def place(self, spec: LeafSpec, i: int, array: np.ndarray) -> None:
        """Puts the addresses of the signals of input port i, which carries `array`, into the table."""
        self.arrays[FIRST_SIGNAL + i] = array
        for name, at in list(spec.inputs.values())[i].signals.items():
            self.table[FIRST_SIGNAL + spec.reads.index(name)] = array.ctypes.data + 8 * at.start

    def take(self, spec: LeafSpec, i: int, vector: BasicVector) -> None:
        """Binds input port i to a vector of our own output ports; copies any other."""
        if id(vector) in OWN:
            self.place(spec, i, vector.value())
            self.bound[i] = vector
            return
        if self.bound[i] is not None:
            self.place(spec, i, np.zeros(vector.size()))
            self.bound[i] = None
        np.copyto(self.arrays[FIRST_SIGNAL + i], vector.value())


def declare_per_context(leaf: LeafSystem, make: Callable[[], Any]) -> Any:
    """Index of a cache entry in which each Context of a leaf keeps an object of its own.

    The entry itself would keep the leaf alive for ever.
    """
    producer = ValueProducer(allocate=lambda: AbstractValue.Make(make()), calc=lambda context, value: None)
    return leaf.DeclareCacheEntry("of this Context", producer, {leaf.nothing_ticket()}).cache_index()


def weak_method(method: Callable) -> Callable:
    """A bound method that does not keep its object alive: Drake holds handlers, and a circle through C++ stays."""
    here, function = ref(method.__self__), method.__func__  # pyright: ignore[reportFunctionMemberAccess]
    return lambda *arguments: function(here(), *arguments)
