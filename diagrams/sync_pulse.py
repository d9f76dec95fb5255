"""The sync pulse of the paper's Fig. 5 and 8a as a Drake system: high in slot 0 of every frame.

    pulse = builder.AddSystem(SyncPulse(robot.machine))
    logger = LogVectorOutput(pulse.GetOutputPort("sync"), builder, 0.002)

The board sends it to the motion capture's analogue input, whose record of it ties both clocks together
(`identification.sync.clock_from_pulses`). Motion capture samples in slot 0 by construction, so nothing in the loop
reads the pulse: it is left out unless asked for, and a log is the same with and without it.
"""

from __future__ import annotations

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from exodrake.core.machine import Machine

ROUNDING = 1e-9  # frames: an instant this close to the start of a frame belongs to it


class SyncPulse(LeafSystem):
    """A pulse at the start of every frame.

    .. pydrake_system::

        name: SyncPulse
        output_ports:
        - sync

    The output [-] is 1 during slot 0 and 0 in the other slots.
    """

    def __init__(self, machine: Machine) -> None:
        super().__init__()
        self.set_name("sync_pulse")
        self.frame, self.share = machine.frame, machine.slot / machine.frame
        self.DeclareVectorOutputPort("sync", 1, self._level, {self.time_ticket()})

    def _level(self, context: Context, level: BasicVector) -> None:
        place = (context.get_time() / self.frame + ROUNDING) % 1.0
        level.SetAtIndex(0, float(place < self.share))
