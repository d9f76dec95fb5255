"""Crossing of a level by a sampled curve."""

import numpy as np


def first_crossing(x: np.ndarray, y: np.ndarray, level: float) -> float:
    """Abscissa at which y (n,) first reaches a level from below, interpolated linearly between samples.

    Args:
        x: (n,) rising.
        y: (n,) in the unit of the level.
        level: to be reached.

    Returns:
        The place in x; x[0] if y begins at the level or above, NaN if it never reaches it.
    """
    above = np.flatnonzero(y >= level)
    if not len(above):
        return float("nan")
    k = int(above[0])
    if k == 0:
        return float(x[0])
    return float(x[k - 1] + (x[k] - x[k - 1]) * (level - y[k - 1]) / (y[k] - y[k - 1]))
