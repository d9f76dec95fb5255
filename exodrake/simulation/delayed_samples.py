"""Sensors on a clock of their own: a sample shows the past, and the two clocks meet where the log is written."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from exodrake.core.machine import Machine


def cubic(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Catmull-Rom interpolation of rows `values` (n, k) at the fractional rows `at` (n,), the ends held; NaN at NaN."""
    last = len(values) - 1
    at = np.clip(at, 0.0, float(last))
    i = np.minimum(np.nan_to_num(at).astype(int), max(last - 1, 0))
    f = (at - i)[:, None]
    p0, p1 = values[np.maximum(i - 1, 0)], values[i]
    p2, p3 = values[np.minimum(i + 1, last)], values[np.minimum(i + 2, last)]
    return p1 + 0.5 * f * (p2 - p0 + f * (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3 + f * (3.0 * (p1 - p2) + p3 - p0)))


def delayed(machine: Machine, records: np.ndarray, indices: list[int]) -> np.ndarray:
    """Logs of some channels of noise-free runs, delayed columns at t - delay.

    Args:
        machine: whose columns they are.
        records: (runs, frames, channels) array of all signals.
        indices: the channels wanted.

    Returns:
        (runs, frames, indices) array.
    """
    at, chosen = machine.offsets, records[:, :, indices]
    for column in (column for column in machine.columns if column.delay):
        assert column.delay
        own = [k for k, i in enumerate(indices) if at[column.signal].start <= i < at[column.signal].stop]
        for row, late in enumerate(records[:, :, at[column.delay.signal].start]):
            if own and late.any():
                chosen[row][:, own] = cubic(chosen[row][:, own], np.arange(len(late)) - late / machine.frame)
    return chosen


def delay_samples(machine: Machine, signals: dict[str, np.ndarray], noise_std: Callable[[str], float]) -> None:
    """Replaces delayed columns in the signals of a run by their values at t - delay; the noise stays where it was.

    Args:
        machine: whose columns they are.
        signals: name -> (frames, channels) array [SI], with the noise inputs.
        noise_std: gives the value of a parameter that scales the noise of a delayed column, by its name [SI].
    """
    for column in machine.columns:
        if (delay := column.delay) and (late := signals[delay.signal][:, 0]).any():
            noise, own = noise_std(delay.noise_std) * signals[delay.noise_input], signals[column.signal]
            signals[column.signal] = cubic(own - noise, np.arange(len(own)) - late / machine.frame) + noise
