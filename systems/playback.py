"""Given signals: `builder.AddSystem(Playback({"tension_ref": rows}, frame=0.02))`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem


class Playback(LeafSystem):
    """Rows of given signals, each held for a frame; the last one stays.

    .. pydrake_system::

        name: Playback
        output_ports:
        - a signal
        - ...

    State: the number of the frame, taken from the time an eighth of a slot (0.25 ms) after the frame has begun, so that
    a log at its end still shows the frame's row.

    Args:
        rows: signal -> (frames, channels) array [SI].
        frame: length of a frame [s].
        delay: when the row changes [s] after the frame's start.

    Example:
        player = Playback({"tension_ref": np.array([[5.0, 3.0, 1.0], [6.0, 3.0, 1.0]])}, frame=0.02)
        simulator = Simulator(player)
        simulator.AdvanceTo(0.03)
        print(player.GetOutputPort("tension_ref").Eval(simulator.get_context()))
    """

    def __init__(self, rows: Mapping[str, np.ndarray], frame: float, delay: float = 2.5e-4) -> None:
        super().__init__()
        self.rows, self.frame = {name: np.array(values, dtype=float) for name, values in rows.items()}, frame
        self.DeclareDiscreteState(1)
        for name, values in self.rows.items():
            self.DeclareVectorOutputPort(name, values.shape[1], partial(self.show, name), {self.xd_ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(frame, delay, self.update)

    def update(self, context: Context, discrete: DiscreteValues) -> None:
        """The next frame has begun."""
        discrete.get_mutable_value(0)[:] = int(context.get_time() / self.frame)

    def show(self, name: str, context: Context, output: BasicVector) -> None:
        """The row of this frame."""
        frame = int(context.get_discrete_state(0).value()[0])
        output.set_value(self.rows[name][min(frame, len(self.rows[name]) - 1)])
