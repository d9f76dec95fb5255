"""Bands that are filtered out of measured signals."""

from __future__ import annotations

from functools import cache

import numpy as np

from exodrake.data.log import fill_columns

Bands = tuple[tuple[float, float], ...]
STEEP = 2  # order of the filter, which runs forwards and backwards
FINE = 4096  # frequencies at which its response is taken


@cache
def filters(bands: Bands, period: float) -> tuple[tuple[np.ndarray, ...], float]:
    """Second-order sections that stop each band, and the share of a white signal's power that they leave."""
    from scipy.signal import butter, sosfreqz

    sections = tuple(np.asarray(butter(STEEP, band, "bandstop", fs=1.0 / period, output="sos")) for band in bands)
    passed = [np.abs(sosfreqz(one, FINE)[1]) ** 4 for one in sections]  # of the power; the filter runs twice
    return sections, float(np.prod(passed, axis=0).mean())


def without(bands: Bands, signals: np.ndarray, period: float) -> np.ndarray:
    """Signals (..., n, columns) sampled every `period` [s] without some bands [Hz]; white ones keep their power."""
    return outside(bands, signals, period) / np.sqrt(filters(bands, period)[1]) if bands else signals


def outside(bands: Bands, signals: np.ndarray, period: float) -> np.ndarray:
    """Signals (..., n, columns) without some bands [Hz], all else as it is."""
    from scipy.signal import sosfiltfilt

    for sections in filters(bands, period)[0]:
        signals = sosfiltfilt(sections, signals, axis=-2)
    return signals


def mismatch(measured: np.ndarray, simulated: np.ndarray, bands: Bands, period: float) -> np.ndarray:
    """Measured less simulated signals (n, columns), NaN where nothing was measured; of a tremor its strength alone.

    No simulation repeats the phase of a tremor: in its bands [Hz] the simulated signal is given the measured phase.
    Both signals are (n, columns), sampled every `period` [s].
    """
    if not bands:
        return measured - simulated
    known = fill_columns(measured)
    seen, repeated = (signal - outside(bands, signal, period) for signal in (known, simulated))
    strength = np.sqrt(np.mean(repeated**2, axis=0) / np.maximum(np.mean(seen**2, axis=0), 1e-30))
    found = outside(bands, known - simulated, period) + seen * (1.0 - strength)
    return np.where(np.isfinite(measured), found, np.nan)
