"""Step responses of each tendon's tension on the full nonlinear loop, without noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.operating import OperatingPoint

BEFORE, AFTER = 10, 300  # frames shown before the step and simulated after it
BAND = 0.02  # settling band, as a share of the step


@dataclass(frozen=True, eq=False)
class StepResponse:
    """Response of one tendon's tension to a step of its reference.

    Attributes:
        channel: name of the tendon. size: of the step [N].
        time: (n,) [s], a sample per slot; the frame with the new reference starts at 0.
        tension: (n, tendons) [N] at the cells.
        rise: 10 to 90 % [s]. overshoot: fraction of the step.
        settling: last time outside +-2 % [s], nan if never inside.
        steady_error: reference minus tension at the end [N].
        crosstalk: largest change of another tendon, fraction of the step.
    """

    channel: str
    size: float
    time: np.ndarray
    tension: np.ndarray
    rise: float
    overshoot: float
    settling: float
    steady_error: float
    crosstalk: float


def crossing(time: np.ndarray, share: np.ndarray, level: float) -> float:
    """First time [s] at which share reaches level, by a straight line between samples; nan if never."""
    above = np.flatnonzero(share >= level)
    if not len(above):
        return float("nan")
    k = int(above[0])
    if k == 0:
        return float(time[0])
    return float(time[k - 1] + (time[k] - time[k - 1]) * (level - share[k - 1]) / (share[k] - share[k - 1]))


def step_figures(time: np.ndarray, share: np.ndarray) -> tuple[float, float, float]:
    """Rise time [s], overshoot and settling time [s] of a response that ought to go from 0 to 1."""
    outside = np.flatnonzero(np.abs(share - 1.0) > BAND)
    last = int(outside[-1]) if len(outside) else -1
    settling = float("nan") if last == len(time) - 1 else float(time[last + 1])
    return crossing(time, share, 0.9) - crossing(time, share, 0.1), max(0.0, float(share.max()) - 1.0), settling


def step_response(loop: FrameMap, point: OperatingPoint, channel: int, size: float = 1.0) -> StepResponse:
    """The loop's response when the reference of a tendon (its index) steps by `size` [N] from the operating point."""
    machine = loop.robot.machine
    rows = np.tile(point.references, (BEFORE + AFTER, 1))
    rows[BEFORE:, channel] += size
    signals = loop.ticks(point.state, rows)
    tension = signals[:, loop.signals["tension"]]
    time = machine.slot * (np.arange(len(signals)) + 1) - BEFORE * machine.frame
    later = time > 0.0
    rise, overshoot, settling = step_figures(time[later], (tension[later, channel] - point.tension[channel]) / size)
    others = np.delete(np.abs(tension - point.tension), channel, axis=1)
    error = float(rows[-1, channel] - tension[-1, channel])
    return StepResponse(
        machine.axes.tendons[channel], size, time, tension, rise, overshoot, settling, error,
        float(others.max(initial=0.0) / abs(size)),
    )  # fmt: skip
