"""Small repairs of measured signals, and bands filtered out of them."""

from __future__ import annotations

from functools import cache

import numpy as np

Bands = tuple[tuple[float, float], ...]
STEEP = 2  # order of the filter, which runs forwards and backwards
FINE = 4096  # frequencies at which its response is taken


def fill_gaps(values: np.ndarray) -> np.ndarray:
    """Missing samples replaced by the last one known."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros_like(values)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), 0))
    return np.nan_to_num(values[last], nan=values[known][0])


def filled_columns(rows: np.ndarray) -> np.ndarray:
    """Signals (n, columns), each filled."""
    return np.column_stack([fill_gaps(column) for column in rows.T])


def without(bands: Bands, signals: np.ndarray, period: float) -> np.ndarray:
    """Signals (..., n, columns) sampled every `period` [s] without some bands [Hz]; white ones keep their power."""
    if not bands:
        return signals
    return outside(bands, signals, period) / np.sqrt(power_kept(bands, period))


@cache
def filters(bands: Bands, period: float) -> tuple[np.ndarray, ...]:
    """Second-order sections that stop each band."""
    from scipy.signal import butter

    return tuple(np.asarray(butter(STEEP, band, "bandstop", fs=1.0 / period, output="sos")) for band in bands)


@cache
def power_kept(bands: Bands, period: float) -> float:
    """Share of a white signal's power that is outside some bands."""
    from scipy.signal import sosfreqz

    kept = np.ones(FINE)
    for sections in filters(bands, period):
        kept *= np.abs(sosfreqz(sections, FINE)[1]) ** 4  # of the power; the filter runs twice
    return float(kept.mean())


def outside(bands: Bands, signals: np.ndarray, period: float) -> np.ndarray:
    """Signals (..., n, columns) without some bands [Hz], all else as it is."""
    from scipy.signal import sosfiltfilt

    for sections in filters(bands, period):
        signals = sosfiltfilt(sections, signals, axis=-2)
    return signals


def mismatch(measured: np.ndarray, simulated: np.ndarray, bands: Bands, period: float) -> np.ndarray:
    """Difference of measured and simulated signals, in the bands of a tremor that of its strength alone.

    No simulation repeats the phase of a tremor: in its bands the simulated signal is given the measured phase.

    Args:
        measured: (n, columns), NaN where nothing was measured.
        simulated: (n, columns).
        bands: of the tremor [Hz].
        period: of the samples [s].

    Returns:
        measured - simulated (n, columns), NaN where nothing was measured.
    """
    if not bands:
        return measured - simulated
    known = filled_columns(measured)
    seen, repeated = (signal - outside(bands, signal, period) for signal in (known, simulated))
    strength = np.sqrt(np.mean(repeated**2, axis=0) / np.maximum(np.mean(seen**2, axis=0), 1e-30))
    found = outside(bands, known - simulated, period) + seen * (1.0 - strength)
    return np.where(np.isfinite(measured), found, np.nan)
