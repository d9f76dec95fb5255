"""The gap as it grows: RMS of each channel in units of its floor, over the last seconds and since the start.

Squares are summed second by second, in frames counted from the log's start, so that the gap does not depend on how the
log arrives.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from exodrake.core.robot import Robot
from exodrake.diagnosis.noise import sensor_noise_std
from exodrake.monitor.companion import Companion, channels
from exodrake.monitor.motion import session
from exodrake.monitor.simulator import KINDS
from exodrake.simulation.simulate import simulate

WINDOW = 10  # s
SKIP = 3  # s at the start that are not counted: the compiled simulator starts at rest, the robot may not
HEARD = 0.5  # share of a window's samples that must be there
OWN = 120.0  # s of the robot's own motion that the floor comes from
WILD = 1e4  # residuals are clipped here [floors], as in `diagnosis.problem`


def floors(robot: Robot) -> np.ndarray:
    """Floor of each channel (24,) [its unit]: what a log of this very robot shows, its sensors' noise and rounding gone
    through twin and replays; at least what the sensor's numbers say."""
    reference = session(robot, 0, OWN)
    log = simulate(robot, reference, seed=0)
    measured = np.concatenate([log.array(kind) for kind in KINDS], axis=1)
    own = Companion(robot).push(reference.tension, measured, last=True)[round(SKIP / robot.machine.frame) :]
    sensors = np.array([sensor_noise_std(robot)[c.kind] for c in channels(robot)])
    return np.maximum(np.sqrt(np.nanmean(own**2, axis=0)), sensors)


@dataclass(frozen=True)
class Reading:
    """The gap at the end of a second.

    Attributes:
        second: seconds since the start, those skipped included. recent: (24,) RMS of the last `WINDOW` s [floors], NaN
        where too little was measured. overall: (24,) RMS since the start [floors]. full: whether a whole window has
        passed.
    """

    second: int
    recent: np.ndarray
    overall: np.ndarray
    full: bool


class Gap:
    """Residuals (n, 24) [SI] -> a `Reading` for every second that is complete."""

    def __init__(self, floor: np.ndarray, frame: float) -> None:
        self.floor, self.second = floor, round(1.0 / frame)
        self.rest = np.zeros((0, len(floor)))
        self.seconds: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=WINDOW)
        self.power, self.count, self.done = np.zeros(len(floor)), np.zeros(len(floor)), 0

    def push(self, residuals: np.ndarray) -> list[Reading]:
        """More residuals; returns the readings of the seconds that they complete."""
        self.rest = np.concatenate([self.rest, residuals])
        found = []
        while len(self.rest) >= self.second:
            rows, self.rest = self.rest[: self.second], self.rest[self.second :]
            self.done += 1
            if self.done > SKIP:
                found.append(self.close(np.clip(rows / self.floor, -WILD, WILD)))
        return found

    def close(self, rows: np.ndarray) -> Reading:
        """The reading at the end of a second of residuals [floors]."""
        known = np.isfinite(rows)
        self.seconds.append((np.sum(np.where(known, rows, 0.0) ** 2, axis=0), known.sum(axis=0)))
        power, count = (np.sum(x, axis=0) for x in zip(*self.seconds))
        self.power, self.count = self.power + self.seconds[-1][0], self.count + self.seconds[-1][1]
        enough = count >= HEARD * self.second * len(self.seconds)
        return Reading(
            self.done, rms(power, np.where(enough, count, 0)), rms(self.power, self.count), len(self.seconds) == WINDOW
        )


def rms(power: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Root of the mean of squares; NaN where nothing was counted."""
    return np.sqrt(np.divide(power, count, out=np.full(len(power), np.nan), where=count > 0))
