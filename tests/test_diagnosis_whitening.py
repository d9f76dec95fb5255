"""Whitening: autoregressive noise of known coefficients becomes white, of unit variance."""

import numpy as np
import pytest
from scipy.signal import lfilter

from exodrake.diagnosis.likelihood import ORDER, fit_whitening

AR1, AR2 = (1.0, -0.9), (1.0, -1.2, 0.5)


def noise(coefficients, std, frames, seed):
    """An autoregressive process e[t] + a1 e[t-1] + ... = std w[t]."""
    return lfilter([std], coefficients, np.random.default_rng(seed).standard_normal(frames))


@pytest.fixture(scope="module")
def whitening():
    """Of four logs with a column of each process."""
    return fit_whitening([np.column_stack([noise(AR1, 0.3, 8000, k), noise(AR2, 2.0, 8000, k + 10)]) for k in range(4)])


@pytest.mark.parametrize(("column", "truth", "std"), [(0, AR1, 0.3), (1, AR2, 2.0)])
def test_coefficients_and_noise_of_an_autoregressive_process_are_recovered(whitening, column, truth, std):
    wanted = np.zeros(ORDER + 1)
    wanted[: len(truth)] = truth
    assert whitening.coefficients[column] == pytest.approx(wanted, abs=0.04)  # 1 / sqrt(32,000) = 0.006 a coefficient
    assert whitening.noise_std[column] == pytest.approx(std, rel=0.02)


def test_whitened_noise_is_white_with_unit_variance(whitening):
    fresh = np.column_stack([noise(AR1, 0.3, 20_000, 31), noise(AR2, 2.0, 20_000, 32)])
    white = whitening(fresh)
    assert white.std(axis=0) == pytest.approx([1.0, 1.0], rel=0.03)
    for column in white.T:
        lags = [np.corrcoef(column[k:], column[:-k])[0, 1] for k in range(1, 20)]
        assert np.abs(lags).max() < 4.0 / np.sqrt(20_000)  # 19 lags within 4 standard deviations
