"""Date at which a gap rose: the change point (`monitor.autocorrelated`) of a channel's power before an alarm.

The alarm uses its own limits, so the scan does not change its rate of false alarms. The scan tells a gap that was there
from the start from one that rose later, and dates it.
"""

from __future__ import annotations

import numpy as np

from exodrake.core.confidence import ALPHA
from exodrake.diagnosis.change_point import LEAST
from exodrake.monitor.autocorrelated import AutocorrelatedChange

SPAN = 60  # s before an alarm that are searched
SMALLEST = 1e-6  # noise variances: no logarithm of less


def rise(powers: np.ndarray, second: int, length: float = 1.0) -> tuple[float, float] | None:
    """Times [s] of the log between which a gap rose (90 % set); None without a rise.

    Args:
        powers: (n,) mean square of each of the last n seconds [noise variances], NaN if nothing was measured.
        second: end of the last one [s].
        length: of one, which is a whole number of frames [s].
    """
    known = np.isfinite(powers)
    if known.sum() < LEAST:
        return None
    times = (second + length * (np.arange(len(powers)) - len(powers) + 0.5))[known]
    logs = np.log(np.maximum(powers[known], SMALLEST))
    if np.ptp(logs) <= 0.0:
        return None
    rng = np.random.default_rng(second)
    p, scan = AutocorrelatedChange(times, length)(logs, rng)
    if p >= ALPHA:
        return None
    change = scan(logs, rng)
    return (change.began[1], change.began[2]) if change.after[0] > change.before[0] else None
