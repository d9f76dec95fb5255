"""Step responses of each channel on the full nonlinear loop, without noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.analysis.crossing import first_crossing
from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.operating_point import OperatingPoint

BEFORE, AFTER = 10, 300  # frames shown before the step and simulated after it
BAND = 0.02  # settling band, as a share of the step


@dataclass(frozen=True, eq=False)
class StepResponse:
    """Response of the controlled quantity to a step of one channel's reference.

    Attributes:
        channel: whose reference steps.
        size: of the step [SI].
        time: (n,) [s], a sample per slot; the frame with the new reference starts at 0.
        output: (n, channels) [SI].
        rise: 10 to 90 % [s].
        overshoot: fraction of the step.
        settling: last time outside +-2 % [s], nan if never inside.
        steady_error: reference minus output at the end [SI].
        crosstalk: largest change of another channel, fraction of the step.
    """

    channel: str
    size: float
    time: np.ndarray
    output: np.ndarray
    rise: float
    overshoot: float
    settling: float
    steady_error: float
    crosstalk: float


def step_figures(time: np.ndarray, share: np.ndarray) -> tuple[float, float, float]:
    """Rise time [s], overshoot [-] and settling time [s] of a response (n,) that ought to go from 0 to 1."""
    outside = np.flatnonzero(np.abs(share - 1.0) > BAND)
    last = int(outside[-1]) if len(outside) else -1
    settling = float("nan") if last == len(time) - 1 else float(time[last + 1])
    rise = first_crossing(time, share, 0.9) - first_crossing(time, share, 0.1)
    return rise, max(0.0, float(share.max()) - 1.0), settling


def step_response(loop: FrameMap, point: OperatingPoint, channel: int, size: float | None = None) -> StepResponse:
    """The loop's response when the reference of a channel (its index) steps by `size` [SI], the loop's own without."""
    machine, size = loop.robot.machine, loop.loop.step if size is None else size
    rows = np.tile(point.references, (BEFORE + AFTER, 1))
    rows[BEFORE:, channel] += size
    signals = loop.ticks(point.state, rows)
    output = signals[:, loop.signals[loop.loop.output]]
    time = machine.slot * (np.arange(len(signals)) + 1) - BEFORE * machine.frame
    later = time > 0.0
    rise, overshoot, settling = step_figures(time[later], (output[later, channel] - point.output[channel]) / size)
    others = np.delete(np.abs(output - point.output), channel, axis=1)
    error = float(rows[-1, channel] - output[-1, channel])
    return StepResponse(
        loop.channels[channel], size, time, output, rise, overshoot, settling, error,
        float(others.max(initial=0.0) / abs(size)),
    )  # fmt: skip
