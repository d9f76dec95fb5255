"""What is fed into twin and replays, as streams: missing samples held, signals smoothed with their rates, rows
delayed."""

from __future__ import annotations

import numpy as np

from exodrake.diagnosis.replay import ORDER, WINDOW

LAG = WINDOW // 2  # frames by which smoothing lags


class Hold:
    """A missing sample (NaN) keeps the last value known, 0 before any is."""

    def __init__(self, channels: int) -> None:
        self.held = np.zeros(channels)

    def push(self, rows: np.ndarray) -> np.ndarray:
        """Rows (n, channels) without gaps."""
        out = rows.copy()
        if not np.isfinite(out).all():
            for row in out:
                row[:] = np.where(np.isfinite(row), row, self.held)
                self.held = row.copy()
        elif len(out):
            self.held = out[-1].copy()
        return out


class Delay:
    """Rows that come out `LAG` frames later."""

    def __init__(self, channels: int) -> None:
        self.waiting = np.zeros((0, channels))

    def push(self, rows: np.ndarray, last: bool) -> np.ndarray:
        """Rows (n, channels) of the next frames; returns those whose time has come, all if no more will."""
        whole = np.concatenate([self.waiting, rows])
        count = len(whole) if last else max(len(whole) - LAG, 0)
        self.waiting = whole[count:]
        return np.ascontiguousarray(whole[:count])


class Smoother:
    """Savitzky-Golay filter over a stream of rows without gaps; the ends are held.

    Sums run in one order whatever the size of the pieces, so that a stream in pieces gives the bits of the whole.
    """

    def __init__(self, frame: float) -> None:
        from scipy.signal import savgol_coeffs

        self.value = savgol_coeffs(WINDOW, ORDER, use="dot")
        self.rate = savgol_coeffs(WINDOW, ORDER, deriv=1, delta=frame, use="dot")
        self.tail: np.ndarray | None = None

    def push(self, rows: np.ndarray, last: bool) -> tuple[np.ndarray, np.ndarray]:
        """Rows (n, channels) of the next frames; returns values and rates [1/s] of those `LAG` back, of all if no more
        will come."""
        if self.tail is None:
            self.tail = np.repeat(rows[:1], LAG, axis=0)
        whole = np.concatenate([self.tail, rows])
        if last:
            whole = np.concatenate([whole, np.repeat(whole[-1:], LAG, axis=0)])
        count = max(len(whole) - 2 * LAG, 0)
        self.tail = whole[count:]
        return dot(self.value, whole, count), dot(self.rate, whole, count)


def dot(weights: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray:
    """Weighted sums of `count` windows of rows."""
    total = np.zeros((count, rows.shape[1]))
    for k, weight in enumerate(weights):
        total += weight * rows[k : k + count]
    return total
