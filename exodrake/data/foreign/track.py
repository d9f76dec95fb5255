"""A foreign column with a clock of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Track:
    """A foreign column with a clock of its own: time (n,) s, values (n,) in the foreign unit."""

    time: np.ndarray
    values: np.ndarray


def median_step(time: np.ndarray) -> float:
    """Median step of a clock (n,) [s]; infinite with a single sample."""
    return float(np.median(np.diff(time))) if len(time) > 1 else float("inf")
