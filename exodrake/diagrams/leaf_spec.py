"""What the Drake leaf of a part is made of: compiled functions, arrays and names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np


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
    """Output ports that are computed: `function(table, 0)` leaves `writes` in the scratch; `reads`: input ports."""

    function: Callable
    reads: tuple[str, ...]
    writes: tuple[str, ...]

    @property
    def ports(self) -> dict[str, tuple[str, str]]:
        """Name of a port -> first and last signal in it: one for each, and a wide one for all if there are several."""
        each = {name: (name, name) for name in self.writes}
        return each | {wide_port(self.writes): (self.writes[0], self.writes[-1])}


def wide_port(writes: tuple[str, ...]) -> str:
    """Name of the port that shows all signals of a function side by side: `tension+tension_spool`."""
    return "+".join(writes)


@dataclass(frozen=True)
class InputSpec:
    """An input port.

    Attributes:
        width: of its vector.
        signals: name -> place in it; empty where the port only says on what a computed port depends.
        state: whether it is connected to a port `memory`: bound to a state once for a Context.
    """

    width: int
    signals: Mapping[str, slice]
    state: bool = False


@dataclass(frozen=True, eq=False)
class LeafSpec:
    """Specification of a leaf: ports, parameters, memory and events.

    Attributes:
        name: of the system.
        inputs: name of an input port -> what it carries.
        parameters: (n,) array [SI], with `parameter_names`.
        memory: (m,) array at the start: the state, then the signals that follow from the state alone.
        signals: name -> place in the scratch memory: the memory, then the signals of computed ports.
        reads: signals and start vectors read, in the order of the table of addresses.
        updates: periodic events.
        start, hold: events that begin anew from the parameters, and that fill the held signals alone.
        start_vectors: name -> (tendons,) array that `start` reads where its port is not connected.
        computed: ports that answer inputs or parameters at once.
        scratch_size: length of the scratch memory.
    """

    name: str
    inputs: Mapping[str, InputSpec]
    parameters: np.ndarray
    parameter_names: tuple[str, ...]
    memory: np.ndarray
    signals: Mapping[str, slice]
    reads: tuple[str, ...]
    updates: tuple[PeriodicUpdate, ...]
    start: Callable
    hold: Callable
    start_vectors: Mapping[str, np.ndarray] = field(default_factory=dict)
    computed: tuple[Feedthrough, ...] = ()
    scratch_size: int = 0
