"""Operations on streams of rows whose result does not depend on how the stream is cut."""

from __future__ import annotations

import numpy as np

from exodrake.core.machine import Machine, signal_count
from exodrake.diagnosis.segment_shares import ORDER, WINDOW
from exodrake.simulation.delayed_samples import cubic

LAG = WINDOW // 2  # frames by which smoothing lags
AHEAD = 2  # frames that interpolation between samples looks ahead
MEMORY = 1000  # frames that a delayed sample may lie back


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
    """Rows that come out some frames later."""

    def __init__(self, channels: int, frames: int) -> None:
        self.waiting, self.frames = np.zeros((0, channels)), frames

    def push(self, rows: np.ndarray, last: bool) -> np.ndarray:
        """Takes rows (n, channels); returns those whose time has come, all of them at the end of the log."""
        whole = np.concatenate([self.waiting, rows])
        count = len(whole) if last else max(len(whole) - self.frames, 0)
        self.waiting = whole[count:]
        return whole[:count]


class Smoother:
    """Savitzky-Golay filter of rows without gaps, and its derivative; the ends are held.

    Sums run in one order however the stream is cut.
    """

    def __init__(self, frame: float) -> None:
        from scipy.signal import savgol_coeffs

        self.value = savgol_coeffs(WINDOW, ORDER, use="dot")
        self.rate = savgol_coeffs(WINDOW, ORDER, deriv=1, delta=frame, use="dot")
        self.tail: np.ndarray | None = None

    def push(self, rows: np.ndarray, last: bool) -> tuple[np.ndarray, np.ndarray]:
        """Takes rows (n, channels); returns values and rates [1/s] of those `LAG` back, of all at the log's end."""
        if self.tail is None:
            if not len(rows):
                return rows, rows
            self.tail = np.repeat(rows[:1], LAG, axis=0)
        whole = np.concatenate([self.tail, rows])
        if last:
            whole = np.concatenate([whole, np.repeat(whole[-1:], LAG, axis=0)])
        count = max(len(whole) - 2 * LAG, 0)
        self.tail = whole[count:]
        return weighted(self.value, whole, count), weighted(self.rate, whole, count)


def weighted(weights: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray:
    """Weighted sums (count, channels) of `count` windows of rows."""
    total = np.zeros((count, rows.shape[1]))
    for k, weight in enumerate(weights):
        total += weight * rows[k : k + count]
    return total


class DelayedSamples:
    """Compared columns of a simulated log; where a column has a delay, its samples show the past.

    Rows come out `ahead` frames later, since interpolation looks ahead; at once on a machine without delays.
    """

    def __init__(self, machine: Machine) -> None:
        at, self.frame, self.places, self.late = machine.offsets, machine.frame, [], []
        for kind in machine.compared:
            column, width = machine.column(kind), machine.column_width(kind)
            if column.delay:
                self.late.append((slice(len(self.places), len(self.places) + width), at[column.delay.signal].start))
            self.places += range(at[column.signal].start, at[column.signal].stop)
        self.ahead = AHEAD if self.late else 0
        self.rows, self.first, self.done = np.zeros((0, signal_count(machine))), 0, 0

    def push(self, record: np.ndarray, last: bool) -> np.ndarray:
        """Takes signals (n, signals) of the next frames; returns (m, compared columns) [SI]."""
        if not self.late:
            return record[:, self.places]
        self.rows = np.concatenate([self.rows, record])
        end = self.first + len(self.rows) - (0 if last else self.ahead)
        here = np.arange(self.done, max(end, self.done)) - self.first
        seen = self.rows[here][:, self.places]
        for columns, delay in self.late:
            back = self.rows[here, delay] / self.frame
            if back.any():
                seen[:, columns] = cubic(self.rows[:, self.places[columns]], here - back)
        self.done += len(here)
        drop = max(len(self.rows) - MEMORY, 0)
        self.rows, self.first = self.rows[drop:], self.first + drop
        return seen
