"""Long logs for figures: the least and the largest sample of each stretch of time, so that no peak is lost; means."""

from __future__ import annotations

import numpy as np


def stretch_of(samples: int, most: int) -> int:
    """Samples of a stretch with which the envelope of a log has `most` samples or fewer; 1 where the log has."""
    return 1 if samples <= most else -(-samples // max(most // 2, 1))


def envelope(values: np.ndarray, stretch: int) -> np.ndarray:
    """The least and the largest sample of each stretch, in the order in which they come.

    Args:
        values: (n, columns), NaN where nothing was measured.
        stretch: samples of a stretch; 1 leaves the values as they are.

    Returns:
        (2 ceil(n / stretch), columns), in equal steps of half a stretch; NaN where a stretch has no sample.
    """
    if stretch <= 1:
        return values
    blocks = blocks_of(values, stretch)
    missing = np.isnan(blocks)
    least = np.where(missing, np.inf, blocks).argmin(axis=1)
    largest = np.where(missing, -np.inf, blocks).argmax(axis=1)
    at = np.stack([np.minimum(least, largest), np.maximum(least, largest)], axis=1)
    return np.take_along_axis(blocks, at, axis=1).reshape(-1, values.shape[1])


def means(values: np.ndarray, stretch: int) -> np.ndarray:
    """The mean of each stretch of values (n, columns), (ceil(n / stretch), columns); NaN where it has no sample."""
    blocks = blocks_of(values, stretch)
    count = np.isfinite(blocks).sum(axis=1)
    return np.where(count > 0, np.nansum(blocks, axis=1) / np.maximum(count, 1), np.nan)


def blocks_of(values: np.ndarray, stretch: int) -> np.ndarray:
    """Values (n, columns) in stretches, (ceil(n / stretch), stretch, columns), the last one filled with NaN."""
    padded = np.full((-(-len(values) // stretch) * stretch, values.shape[1]), np.nan)
    padded[: len(values)] = values
    return padded.reshape(-1, stretch, values.shape[1])
