"""Scan over time: the largest mean square and the largest mean of residuals, which show bursts and biases."""

from __future__ import annotations

import numpy as np

from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.p_values import exceeding

WINDOW = 2.0  # s (selection.md)


def scan(likelihood: Likelihood, rows: np.ndarray) -> np.ndarray:
    """Largest mean square, and largest |mean| sqrt(frames), over windows that overlap by half, and over whole logs.

    Args:
        likelihood: views of the case.
        rows: (n, samples) whitened residuals [noise_std].

    Returns:
        (n, 2) both statistics of each row.
    """
    length, found = max(2, round(WINDOW / likelihood.robot.machine.frame)), np.zeros((len(rows), 2))
    for view, part in zip(likelihood.views, likelihood.split(rows), strict=True):
        ends = np.cumsum([trial.measured.size for trial in view.problem.fit])[:-1]
        for trial, log in zip(view.problem.fit, np.split(part, ends, axis=1), strict=True):
            frames, columns = trial.measured.shape
            log = log.reshape(len(rows), frames, columns)
            size = min(length, frames)
            power = sliding_mean(log**2, size).max(axis=(1, 2))
            means = np.abs(sliding_mean(log, size)).max(axis=(1, 2)) * np.sqrt(size)
            means = np.maximum(means, np.abs(log.mean(axis=1)).max(axis=1) * np.sqrt(frames))
            found = np.maximum(found, np.stack([power, means], axis=1))
    return found


def sliding_mean(logs: np.ndarray, size: int) -> np.ndarray:
    """Means (n, windows, columns) of logs (n, frames, columns) in windows of `size` frames, the last one at the end."""
    starts = np.unique(np.r_[np.arange(0, logs.shape[1] - size + 1, max(size // 2, 1)), logs.shape[1] - size])
    sums = np.cumsum(logs, axis=1, dtype=float)
    sums = np.concatenate([np.zeros_like(sums[:, :1]), sums], axis=1)
    return (sums[:, starts + size] - sums[:, starts]) / size


def local_levels(draws: np.ndarray, found: np.ndarray) -> list[float]:
    """p-value of each statistic of a scan (1, statistics) under draws (n, statistics)."""
    return [exceeding(column, value) for column, value in zip(draws.T, found[0], strict=True)]
