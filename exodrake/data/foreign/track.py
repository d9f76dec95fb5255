"""A foreign column with a clock of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ALIKE = 0.1  # relative difference of a frame and a recording's step up to which it has one sample a frame: assumed


@dataclass(frozen=True, eq=False)
class Track:
    """A foreign column with a clock of its own: time (n,) s, values (n,) in the foreign unit."""

    time: np.ndarray
    values: np.ndarray


def median_step(time: np.ndarray) -> float:
    """Median step of a clock (n,) [s]; infinite with a single sample."""
    return float(np.median(np.diff(time))) if len(time) > 1 else float("inf")


def has_one_sample_a_frame(step: float, frame: float) -> bool:
    """Whether a clock of this step [s] has about one sample in each frame [s]."""
    return abs(step / frame - 1.0) < ALIKE
