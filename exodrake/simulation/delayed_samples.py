"""Motion capture on a clock of its own: pictures show the past, and the two clocks meet where the log is written."""

from __future__ import annotations

import numpy as np

from exodrake.core.machine import Machine


def cubic(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Catmull-Rom interpolation of rows `values` (n, k) at the fractional rows `at` (n,), the ends held."""
    last = len(values) - 1
    at = np.clip(at, 0.0, float(last))
    i = np.minimum(at.astype(int), max(last - 1, 0))
    f = (at - i)[:, None]
    p0, p1 = values[np.maximum(i - 1, 0)], values[i]
    p2, p3 = values[np.minimum(i + 1, last)], values[np.minimum(i + 2, last)]
    return p1 + 0.5 * f * (p2 - p0 + f * (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3 + f * (3.0 * (p1 - p2) + p3 - p0)))


def seen_late(machine: Machine, records: np.ndarray, places: list[int]) -> np.ndarray:
    """The wires `places` of noise-free records (rows, n, wires), angles taken at t - lateness: (rows, n, places)."""
    from exodrake.core.machine import offsets

    at = offsets(machine)
    chosen = records[:, :, places]
    if "mocap_delay" not in at:
        return chosen
    angles = [k for k, p in enumerate(places) if at["angle_read"].start <= p < at["angle_read"].stop]
    for row, record in enumerate(records):
        late = record[:, at["mocap_delay"].start]
        if angles and late.any():
            chosen[row][:, angles] = cubic(chosen[row][:, angles], np.arange(len(late)) - late / machine.frame)
    return chosen
