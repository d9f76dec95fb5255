"""The alarm: a gap over the last 10 s above the limit that healthy robots stay below (`live.calibrate`)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from exodrake.core.robot import Robot
from exodrake.monitor.companion import LOOP, Channel, channels
from exodrake.monitor.gap import Reading

LIMITS = "limits.yaml"


@dataclass(frozen=True)
class Alarm:
    """What stands out: the segment whose replay is furthest above its limit (`LOOP` if only the closed loop is), the
    channel in it, its gap and its limit [floors], the second since the start, and how many channels are above
    theirs."""

    second: int
    channel: Channel
    gap: float
    limit: float
    above: int


@cache
def calibration() -> dict[str, Any]:
    """The shipped file of limits."""
    import yaml

    return yaml.safe_load((files("exodrake.monitor") / LIMITS).read_text())


def limits(robot: Robot) -> np.ndarray:
    """Limit of each channel (24,) [floors]."""
    table = calibration()["limits"]
    return np.array([table[c.segment][c.column] for c in channels(robot)])


def judge(reading: Reading, listed: tuple[Channel, ...], limit: np.ndarray) -> Alarm | None:
    """The alarm of a reading; None below all limits, and until a whole window has passed."""
    ratio = np.nan_to_num(reading.recent / limit)
    if not reading.full or ratio.max() <= 1.0:
        return None
    replayed = np.array([c.segment != LOOP for c in listed])
    beyond = ratio * replayed
    worst = int(beyond.argmax() if beyond.max() > 1.0 else ratio.argmax())
    return Alarm(
        reading.second, listed[worst], float(reading.recent[worst]), float(limit[worst]), int((ratio > 1.0).sum())
    )
