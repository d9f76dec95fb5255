"""Smoothing of marker paths by the discrete smoothing spline (Whittaker-Henderson), which also fills short gaps.

    minimise  sum over seen frames (y - z)^2 + lambda sum (third difference of z)^2
    gain      1 / (1 + lambda (2 sin(pi f dt))^6)

lambda gives a gain of 1/2 at the cut-off frequency; at a twentieth of it the gain differs from 1 by 2e-8, so slow
finger motion is unchanged. A missing sample has no weight and takes the value of the spline; long gaps stay missing.
"""

import numpy as np

from exodrake.core.errors import InputError

ORDER = 3


def smooth(
    time: np.ndarray, positions: np.ndarray, cutoff: float, longest_gap: float, source: str = "recording"
) -> np.ndarray:
    """Smooth marker paths.

    Args:
        time: (frames,) evenly spaced [s].
        positions: (frames, markers, 3) [m], NaN where missing.
        cutoff: Cut-off frequency [Hz].
        longest_gap: Longest gap to fill [s].
        source: Name of the recording, for errors.

    Returns:
        Smoothed positions (frames, markers, 3) [m].

    Raises:
        InputError: For uneven frames or a cut-off beyond half the frame rate.
    """
    step = _even_step(time, source)
    if not 0 < cutoff < 0.5 / step:
        raise InputError(
            f"{source}: cut-off {cutoff:g} Hz must lie between 0 and half the frame rate, {0.5 / step:g} Hz"
        )
    stiffness = (2 * np.sin(np.pi * cutoff * step)) ** (-2 * ORDER)
    result = np.full_like(positions, np.nan)
    for number in range(positions.shape[1]):
        seen = np.isfinite(positions[:, number]).all(axis=1)
        for start, stop in _segments(seen, round(longest_gap / step)):
            segment = slice(start, stop)
            result[segment, number] = _spline(positions[segment, number], seen[segment], stiffness)
    return result


def _even_step(time: np.ndarray, source: str) -> float:
    steps = np.diff(time)
    step = float(np.median(steps))
    uneven = np.abs(steps - step) > step / 2
    if uneven.any():
        where = int(np.argmax(uneven))
        at, wide = time[where], 1e3 * steps[where]
        raise InputError(
            f"{source}: frame {where} at {at:g} s is followed after {wide:g} ms, the others after {1e3 * step:g} ms"
        )
    return step


def _segments(seen: np.ndarray, gap: int) -> list[tuple[int, int]]:
    """First and one past last frame of each segment without a gap longer than `gap` frames."""
    frames = np.flatnonzero(seen)
    if not len(frames):
        return []
    breaks = np.flatnonzero(np.diff(frames) > gap + 1)
    starts, stops = np.r_[frames[0], frames[breaks + 1]], np.r_[frames[breaks], frames[-1]]
    return [(int(a), int(b) + 1) for a, b in zip(starts, stops, strict=True)]


def _spline(path: np.ndarray, seen: np.ndarray, stiffness: float) -> np.ndarray:
    """Smooth one segment: path (n, 3) [m] and mask (n,) to z (n, 3) [m]."""
    from scipy.linalg import solveh_banded

    n = len(path)
    if np.count_nonzero(seen) <= ORDER:
        return np.where(seen[:, None], path, np.nan)
    coefficients = np.array([-1.0, 3.0, -3.0, 1.0])
    bands = np.zeros((ORDER + 1, n))
    for i, first in enumerate(coefficients):
        for j in range(i, ORDER + 1):
            bands[j - i, i : n - ORDER + i] += stiffness * first * coefficients[j]
    bands[0] += seen
    return solveh_banded(bands, np.where(seen[:, None], path, 0.0), lower=True)
