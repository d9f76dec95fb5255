"""The exogenous inputs of a Diagram as a system: references and noise inputs, one row a frame."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pydrake.systems.framework import Context, DiscreteStateIndex, DiscreteValues, LeafSystem

from exodrake.core.machine import Machine
from exodrake.diagrams.leaf import slice_of_memory

OUTSIDE = "outside"


class ExogenousInputs(LeafSystem):
    """Rows of the exogenous signals, each held for a frame.

    .. pydrake_system::

        name: ExogenousInputs
        output_ports:
        - an exogenous signal
        - ...
        - memory

    A row comes a quarter of a slot late, so that a frame's end still shows its own; the last row stays.
    Port `memory` shows the row as a whole.
    """

    def __init__(self, machine: Machine, rows: dict[str, np.ndarray]) -> None:
        """Takes the rows of each signal, (frames, channels) arrays in the unit of the signal."""
        super().__init__()
        self.set_name(OUTSIDE)
        self.signals, at = {}, 0
        for name, values in rows.items():
            self.signals[name], at = slice(at, at + values.shape[1]), at + values.shape[1]
        table = np.hstack(list(rows.values()))
        state = DiscreteStateIndex(int(self.DeclareDiscreteState(table[0])))
        for name, place in self.signals.items():
            self.DeclareVectorOutputPort(name, place.stop - place.start, slice_of_memory(place), {self.xd_ticket()})
        self.DeclareStateOutputPort("memory", state)
        late = machine.frame + 0.25 * machine.slot
        self.DeclarePeriodicDiscreteUpdateEvent(machine.frame, late, next_row(table, machine.frame))


def next_row(table: np.ndarray, frame: float) -> Callable[[Context, DiscreteValues], None]:
    """The handler that shows the row of the frame that has begun."""
    last = len(table) - 1

    def update(context: Context, discrete: DiscreteValues) -> None:
        discrete.set_value(0, table[min(int(context.get_time() / frame), last)])

    return update
