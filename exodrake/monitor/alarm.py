"""Alarm: the gap over a moving window exceeds its limit, below which healthy robots stay (`monitor.calibrate`)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from exodrake.core.machine import Machine
from exodrake.core.yaml_file import read_yaml
from exodrake.machines.library import machine_folders
from exodrake.monitor.channels import LOOP, Channel, channels
from exodrake.monitor.gap import Reading

LIMITS = "alarm_limits.yaml"  # in the folder of the machine


@dataclass(frozen=True)
class Alarm:
    """Alarm of a gap above its limit.

    Attributes:
        second: time since the start [s].
        channel: the replayed channel furthest above its limit; one of the closed loop only if no replay is above.
        gap: its gap [noise standard deviations].
        limit: its limit [noise standard deviations].
        above: number of channels above their limits.
        rose: times [s] between which its gap rose (90 % set); None if it was there throughout.
    """

    second: int
    channel: Channel
    gap: float
    limit: float
    above: int
    rose: tuple[float, float] | None = None


@cache
def calibration(name: str) -> dict[str, Any] | None:
    """The file of limits in the machine's folder; None of a machine that has none."""
    folder = machine_folders().get(name)
    return read_yaml(folder / LIMITS) if folder is not None and (folder / LIMITS).is_file() else None


def limits(machine: Machine) -> np.ndarray | None:
    """Limit of each channel (channels,) [noise standard deviations]; None of a machine without calibrated limits."""
    found = calibration(machine.name)
    return None if found is None else np.array([found["limits"][c.segment][c.column] for c in channels(machine)])


def judge(reading: Reading, listed: tuple[Channel, ...], limit: np.ndarray) -> Alarm | None:
    """The alarm of a reading; None below all limits, and until a whole window has passed.

    Args:
        reading: gap of each channel.
        listed: the channels.
        limit: (channels,) limits [noise standard deviations].
    """
    ratio = np.nan_to_num(reading.recent / limit)
    if not reading.full or ratio.max() <= 1.0:
        return None
    replayed = ratio * np.array([c.segment != LOOP for c in listed])
    worst = int(replayed.argmax() if replayed.max() > 1.0 else ratio.argmax())
    return Alarm(
        reading.second, listed[worst], float(reading.recent[worst]), float(limit[worst]), int((ratio > 1.0).sum())
    )
