"""The controller's clock on the clock of the motion capture, from the record of the sync pulse (paper, Fig. 5 and 8a).

start, skew = clock_from_pulses(time, level, robot.machine.frame)
controller_time = (capture_time - start) / (1.0 + skew)
"""

from __future__ import annotations

import numpy as np

from exodrake.core.errors import InputError


def clock_from_pulses(time: np.ndarray, level: np.ndarray, frame: float) -> tuple[float, float]:
    """Start and skew of the controller's clock, by least squares over the rising edges.

    Args:
        time: (n,) instants on the clock of the motion capture [s].
        level: (n,) analogue record of the sync pulse, any unit.
        frame: time between pulses on the controller's clock [s].

    Returns:
        The instant of the first pulse recorded [s], and the relative excess of a frame's duration [-]: 1e-4 where the
        capture counts 100 us more in a second than the controller. Missed pulses are bridged.

    Raises:
        InputError: fewer than two pulses rise in the record, or time does not increase.
    """
    if not (np.diff(time) > 0.0).all():
        raise InputError("sync pulse: time does not increase")
    middle = (np.min(level) + np.max(level)) / 2.0
    rises = np.flatnonzero((level[:-1] <= middle) & (level[1:] > middle))
    if len(rises) < 2:
        raise InputError(f"sync pulse: {len(rises)} rising edges, wanted 2 or more")
    share = (middle - level[rises]) / (level[rises + 1] - level[rises])
    edges = time[rises] + share * (time[rises + 1] - time[rises])
    count = np.concatenate([[0], np.cumsum(np.round(np.diff(edges) / frame))])
    slope, start = np.polyfit(count, edges, 1)
    return float(start), float(slope / frame - 1.0)
