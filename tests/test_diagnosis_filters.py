"""Bands that are filtered out of residuals, what they take and leave; whitening of autoregressive noise."""

import numpy as np
import pytest
from scipy.signal import lfilter

from exodrake.data.log import fill_gaps
from exodrake.diagnosis.likelihood import ORDER, fit_whitening
from exodrake.diagnosis.noise import mismatch, without

PERIOD = 0.02


@pytest.mark.parametrize("frequency, left", [(2.0, 1.0), (7.0, 0.0), (12.0, 1.0)])
def test_a_notched_band_takes_what_is_in_it_and_nothing_else(frequency, left):
    time = PERIOD * np.arange(4000)
    wave = np.sin(2 * np.pi * frequency * time)[None, :, None]
    kept = without(((6.0, 8.0),), wave, PERIOD)
    power = np.mean(kept[0, 200:-200, 0] ** 2)
    assert power == pytest.approx(0.5 * left / (1.0 - 2.0 * 2.0 * PERIOD), abs=0.05)  # white noise keeps its power


def test_white_noise_keeps_its_power_without_a_band():
    noise = np.random.default_rng(4).standard_normal((1, 60_000, 2))
    left = without(((4.0, 6.4), (9.0, 11.4)), noise, PERIOD)
    assert np.mean(left**2) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("frequency, strength, left", [(7.0, 1.0, 0.0), (7.0, 0.6, 0.4), (2.0, 1.0, np.sqrt(2.0))])
def test_in_the_band_of_a_tremor_only_its_strength_counts(frequency, strength, left):
    """A quarter turn out of phase: sin - cos has sqrt(2) the amplitude of either."""
    time = PERIOD * np.arange(4000)
    measured = np.sin(2 * np.pi * frequency * time)[:, None]
    simulated = strength * np.cos(2 * np.pi * frequency * time)[:, None]
    gap = mismatch(measured, simulated, ((6.0, 8.0),), PERIOD)
    assert np.sqrt(np.mean(gap[200:-200] ** 2)) == pytest.approx(left * np.sqrt(0.5), abs=0.02)


def test_gaps_are_filled_with_the_last_known_sample():
    values = np.array([np.nan, 1.0, np.nan, np.nan, 3.0])
    np.testing.assert_array_equal(fill_gaps(values), [1.0, 1.0, 1.0, 1.0, 3.0])
    np.testing.assert_array_equal(fill_gaps(np.full(3, np.nan)), np.zeros(3))


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
