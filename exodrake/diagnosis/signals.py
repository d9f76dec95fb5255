"""Small repairs of measured signals, and bands filtered out of them."""

from __future__ import annotations

import numpy as np

Bands = tuple[tuple[float, float], ...]
STEEP = 2  # order of the filter, which runs forwards and backwards
FINE = 4096  # frequencies at which its response is taken


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
    from scipy.signal import butter, sosfiltfilt, sosfreqz

    kept = np.ones(FINE)
    for low, high in bands:
        sections = butter(STEEP, (low, high), "bandstop", fs=1.0 / period, output="sos")
        signals = sosfiltfilt(sections, signals, axis=-2)
        kept *= np.abs(sosfreqz(sections, FINE)[1]) ** 4  # of the power; the filter runs twice
    return signals / np.sqrt(kept.mean())
