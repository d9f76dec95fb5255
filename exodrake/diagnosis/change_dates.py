"""Candidate shapes and dates of a change in a series, as regressors beside a constant."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

STEP, RAMP, BOTH = "step", "ramp", "step and ramp"


@dataclass(frozen=True, eq=False)
class Dates:
    """Candidate change dates and their regressors.

    Attributes:
        shape: (candidates,) names.
        low, high: (candidates,) ends of the interval of time that a candidate stands for [unit of times].
        columns: (candidates, points, 2) g of each, the second one zero but for `BOTH`.
        added: (candidates, points, 2) orthonormal, whitened, orthogonal to a constant.
    """

    shape: np.ndarray
    low: np.ndarray
    high: np.ndarray
    columns: np.ndarray
    added: np.ndarray

    def gains(self, rows: np.ndarray) -> np.ndarray:
        """Sum of squares (candidates, n) that each candidate takes up of whitened series (points, n)."""
        flat = self.added.transpose(0, 2, 1).reshape(-1, self.added.shape[1])
        return ((flat @ rows) ** 2).reshape(len(self.added), 2, -1).sum(axis=1)

    def where(self, mask: np.ndarray) -> Dates:
        """The candidates of a mask (candidates,)."""
        return Dates(self.shape[mask], self.low[mask], self.high[mask], self.columns[mask], self.added[mask])


def dates_of(times: np.ndarray, white: np.ndarray, constant: np.ndarray, grid: int) -> Dates:
    """Shapes and dates that are tried on points at times (points,).

    A step may lie in any gap between two points. A ramp may begin at any point but the last two, and `grid` times
    between two of them, each for the dates up to its neighbours; one that begins later equals a step.

    Args:
        times: increasing (points,).
        white: (points, points) whitening.
        constant: (points,) whitened constant of length 1.
        grid: dates of a ramp's begin by gap.
    """
    found = [(STEP, a, b, times > a, 0.0 * times) for a, b in pairwise(times)]
    for a, b in pairwise(times[:-1]):
        cell = (b - a) / grid
        found += [(RAMP, t - cell, t + cell, np.maximum(times - t, 0.0), 0.0 * times) for t in
                  a + cell * np.arange(grid)]  # fmt: skip
    found += [(BOTH, a, b, times > a, np.maximum(times - 0.5 * (a + b), 0.0)) for a, b in pairwise(times[:-1])]
    shape, low, high, *columns = zip(*found, strict=True)
    stacked = np.array(columns, dtype=float).transpose(1, 2, 0)
    rows = np.einsum("ij,cjk->cik", white, stacked)
    rows = rows - np.einsum("i,j,cjk->cik", constant, constant, rows)
    first = rows[..., 0] / np.linalg.norm(rows[..., 0], axis=1, keepdims=True)
    second = rows[..., 1] - np.einsum("ci,ci->c", first, rows[..., 1])[:, None] * first
    size = np.linalg.norm(second, axis=1, keepdims=True)
    second = np.divide(second, size, out=np.zeros_like(second), where=size > 1e-9)
    return Dates(np.array(shape), np.array(low), np.array(high), stacked, np.stack([first, second], axis=-1))
