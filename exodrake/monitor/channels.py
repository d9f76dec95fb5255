"""Residual channels of a machine: each compared column against the closed loop and against its segment's replay."""

from __future__ import annotations

from dataclasses import dataclass

from exodrake.core.machine import Machine
from exodrake.core.segment import Segment

LOOP = "loop"


@dataclass(frozen=True)
class Channel:
    """A column of residuals: `segment` (or `LOOP`), kind of log column, and channel of that kind."""

    segment: str
    kind: str
    channel: str

    @property
    def column(self) -> str:
        """Column of the log."""
        return f"{self.kind}_{self.channel}"


def replayed_segments(machine: Machine) -> dict[str, Segment]:
    """Column kind -> segment that ends in it; empty where a single segment is the closed loop itself."""
    found = {s.output: s for s in machine.segments if s.output in machine.compared}
    return found if len(found) > 1 else {}


def compared_columns(machine: Machine) -> tuple[tuple[str, str], ...]:
    """Kind and channel of each compared column."""
    return tuple((k, c) for k in machine.compared for c in machine.channels(machine.column(k).signal))


def channels(machine: Machine) -> tuple[Channel, ...]:
    """All channels: against the closed loop, then against the replays."""
    columns, segments = compared_columns(machine), replayed_segments(machine)
    loop = tuple(Channel(LOOP, kind, channel) for kind, channel in columns)
    return loop + tuple(Channel(segments[kind].name, kind, channel) for kind, channel in columns if kind in segments)
