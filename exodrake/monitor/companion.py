"""A robot's model beside its growing log: the compiled simulator in closed loop and the replay of each segment, and
how far the log is from them.

Rows are frames; `SIGNALS` are the columns of what is measured, `CHANNELS` those of a residual: twice every signal, once
against the compiled simulator and once against the replay of the segment that ends at it. A residual comes out `LAG`
frames after its frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.core.robot import Robot
from exodrake.monitor.feed import LAG, Delay, Hold, Smoother
from exodrake.monitor.segments import ControllerReplay, FingerReplay, MotorReplay, TendonReplay
from exodrake.monitor.simulator import KINDS, ClosedLoop

TENSION, STROKE, COMMAND, ANGLE = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)  # places of `KINDS` in a row
FED = [*range(0, 6), *range(9, 12)]
LOOP = "loop"
SEGMENTS = {"tension": "tendon", "stroke": "motor", "speed_cmd": "controller", "angle": "finger"}


@dataclass(frozen=True)
class Channel:
    """A column of residuals: `segment` (or `LOOP`), kind of signal, and wire or joint."""

    segment: str
    kind: str
    channel: str

    @property
    def column(self) -> str:
        """The log's column."""
        return f"{self.kind}_{self.channel}"


def signals(robot: Robot) -> tuple[tuple[str, str], ...]:
    """Kind and channel of each measured column, in the order of `KINDS`."""
    axes = robot.machine.axes
    return tuple((k, channel) for k in KINDS for channel in (axes.joints if k == "angle" else axes.tendons))


def channels(robot: Robot) -> tuple[Channel, ...]:
    """All channels: against the compiled simulator, then against the replays."""
    listed = signals(robot)
    loop = tuple(Channel(LOOP, kind, channel) for kind, channel in listed)
    return loop + tuple(Channel(SEGMENTS[kind], kind, channel) for kind, channel in listed)


class Companion:
    """Twin and replays of one robot, from the start of a log on."""

    def __init__(self, robot: Robot) -> None:
        frame = robot.machine.frame
        self.simulator = ClosedLoop(robot, LAG)
        self.controller, self.motor = ControllerReplay(robot), MotorReplay(robot)
        self.tendon, self.finger = TendonReplay(robot), FingerReplay(robot, 0)
        self.hold_reference, self.hold = Hold(3), Hold(9)
        self.smooth, self.rows, self.known = Smoother(frame), Delay(24), np.zeros(12, dtype=bool)

    def push(self, reference: np.ndarray, measured: np.ndarray, last: bool = False) -> np.ndarray:
        """The next frames: references (n, 3) [N] and measured (n, 12) [SI], NaN where missing.

        Returns (m, 24) measured - model [SI], NaN where a signal, or what its replay needs, is missing. `last`: no more
        frames will come, and those that wait come out, too.
        """
        asked = self.hold_reference.push(reference)
        looped = self.simulator.push(asked, last)
        whole = self.hold.push(measured[:, FED])
        fed, rate = (thirds(x) for x in self.smooth.push(whole, last))
        rows = self.rows.push(np.concatenate([asked, whole, measured], axis=1), last)
        asked, read, was = rows[:, :3], rows[:, 3:6], rows[:, 12:]
        ordered = self.controller.push(*map(np.ascontiguousarray, (asked, read)))
        sent = np.where(np.isfinite(was[:, COMMAND]), was[:, COMMAND], ordered)
        strokes = self.motor.push(sent, fed[0], rate[0], np.ascontiguousarray(was[:, STROKE]))
        tensions = self.tendon.push(fed[1], rate[1], fed[2], rate[2])
        angles = self.finger.push(fed[0], rate[0], last)
        replays = np.concatenate([tensions, strokes, ordered, angles], axis=1)
        return np.concatenate([was - looped, np.where(self.usable(was), was - replays, np.nan)], axis=1)

    def usable(self, was: np.ndarray) -> np.ndarray:
        """Where (n, 12) each replay had its inputs, in this frame and in the one before."""
        here = np.isfinite(was)
        both = here & np.concatenate([self.known[None], here[:-1]])[: len(here)]
        self.known = here[-1] if len(here) else self.known
        tension, stroke, angle = (both[:, x].all(axis=1) for x in (TENSION, STROKE, ANGLE))
        return np.repeat(np.column_stack([stroke & angle, tension, tension, tension]), 3, axis=1)


def thirds(rows: np.ndarray) -> list[np.ndarray]:
    """Rows (n, 9) as three of (n, 3), each contiguous whatever n, so that numba compiles for one layout only."""
    return [np.ascontiguousarray(part) for part in np.split(rows, 3, axis=1)]
