"""Small repairs of measured signals, and bands filtered out of them."""

from __future__ import annotations

import numpy as np

Bands = tuple[tuple[float, float], ...]
STEEP = 2  # order of the filter, which runs forwards and backwards


def filled(values: np.ndarray) -> np.ndarray:
    """Missing samples replaced by the last one known."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros_like(values)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), 0))
    return np.nan_to_num(values[last], nan=values[known][0])


def without(bands: Bands, signals: np.ndarray, period: float) -> np.ndarray:
    """Signals (..., n, columns) sampled every `period` [s] without some bands [Hz]; white ones keep their power."""
    if not bands:
        return signals
    from scipy.signal import butter, sosfiltfilt

    kept = 1.0
    for low, high in bands:
        signals = sosfiltfilt(butter(STEEP, (low, high), "bandstop", fs=1.0 / period, output="sos"), signals, axis=-2)
        kept -= 2.0 * (high - low) * period
    return signals / np.sqrt(kept)
