"""Whitening: residuals filtered so that noise of the measured spectrum becomes white with unit variance.

The noise of a residual differs from that of the sensor: it passes through the loop, and encoder steps colour it. It is
measured as the difference of two simulated runs of the retuned robot, with and without noise and quantisation. An
autoregressive model is fitted to each column by the Yule-Walker equations (Kay, Modern Spectral Estimation, 1988,
ch. 7):

    e[t] + a1 e[t-1] + ... + ap e[t-p] = s w[t]          w white, unit variance
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

ORDER = 12  # frames of memory, 0.24 s at 50 Hz: longer than a bus round trip and the encoder's steps in motion; assumed
REGULARISATION = 1e-4  # of the variance, added to it: an encoder at rest has a singular spectrum


@dataclass(frozen=True, eq=False)
class Whitening:
    """Autoregressive noise model: `coefficients` (columns, ORDER + 1), `noise_std` (columns,) of the innovations."""

    coefficients: np.ndarray
    noise_std: np.ndarray

    def __call__(self, residuals: np.ndarray) -> np.ndarray:
        """Whitened residuals [-] of residuals (..., frames, columns)."""
        taps, out = self.coefficients.T / self.noise_std, np.empty(residuals.shape)
        convolve(residuals.reshape(-1, *residuals.shape[-2:]), taps, out.reshape(-1, *residuals.shape[-2:]))
        return out


@njit(cache=True, nogil=True)
def convolve(rows: np.ndarray, taps: np.ndarray, out: np.ndarray) -> None:
    """Filters signals `rows` (rows, frames, columns) by taps (lags, columns) into `out`, from zero."""
    for k in range(len(rows)):
        for t in range(rows.shape[1]):
            out[k, t] = 0.0
            for lag in range(min(len(taps), t + 1)):
                for c in range(rows.shape[2]):
                    out[k, t, c] += taps[lag, c] * rows[k, t - lag, c]


def whitening_of(noise: Sequence[np.ndarray]) -> Whitening:
    """The noise model of noise records (frames, columns) of several logs."""
    from scipy.linalg import solve_toeplitz

    coefficients, noise_std = [], []
    for j in range(noise[0].shape[1]):
        sums = np.sum([autocovariance(record[:, j]) for record in noise], axis=0)
        covariance = sums / sum(len(record) for record in noise)
        covariance[0] = max(covariance[0] * (1.0 + REGULARISATION), 1e-12)
        prediction = solve_toeplitz(covariance[:-1], covariance[1:])
        coefficients.append(np.concatenate([[1.0], -prediction]))
        noise_std.append(np.sqrt(max(covariance[0] - prediction @ covariance[1:], 1e-8)))
    return Whitening(np.array(coefficients), np.array(noise_std))


def autocovariance(record: np.ndarray) -> np.ndarray:
    """Sums of lagged products (ORDER + 1,) of a record (frames,)."""
    return np.array([record[k:] @ record[: len(record) - k] for k in range(ORDER + 1)])
