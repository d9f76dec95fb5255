"""Bands that are filtered out of residuals: what they take, and what they leave."""

import numpy as np
import pytest

from exodrake.data.log import fill_gaps
from exodrake.diagnosis import filters

PERIOD = 0.02


@pytest.mark.parametrize("frequency, left", [(2.0, 1.0), (7.0, 0.0), (12.0, 1.0)])
def test_a_notched_band_takes_what_is_in_it_and_nothing_else(frequency, left):
    time = PERIOD * np.arange(4000)
    wave = np.sin(2 * np.pi * frequency * time)[None, :, None]
    kept = filters.without(((6.0, 8.0),), wave, PERIOD)
    power = np.mean(kept[0, 200:-200, 0] ** 2)
    assert power == pytest.approx(0.5 * left / (1.0 - 2.0 * 2.0 * PERIOD), abs=0.05)  # white noise keeps its power


def test_white_noise_keeps_its_power_without_a_band():
    noise = np.random.default_rng(4).standard_normal((1, 60_000, 2))
    left = filters.without(((4.0, 6.4), (9.0, 11.4)), noise, PERIOD)
    assert np.mean(left**2) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("frequency, strength, left", [(7.0, 1.0, 0.0), (7.0, 0.6, 0.4), (2.0, 1.0, np.sqrt(2.0))])
def test_in_the_band_of_a_tremor_only_its_strength_counts(frequency, strength, left):
    """A quarter turn out of phase: sin - cos has sqrt(2) the amplitude of either."""
    time = PERIOD * np.arange(4000)
    measured = np.sin(2 * np.pi * frequency * time)[:, None]
    simulated = strength * np.cos(2 * np.pi * frequency * time)[:, None]
    gap = filters.mismatch(measured, simulated, ((6.0, 8.0),), PERIOD)
    assert np.sqrt(np.mean(gap[200:-200] ** 2)) == pytest.approx(left * np.sqrt(0.5), abs=0.02)


def test_gaps_are_filled_with_the_last_known_sample():
    values = np.array([np.nan, 1.0, np.nan, np.nan, 3.0])
    np.testing.assert_array_equal(fill_gaps(values), [1.0, 1.0, 1.0, 1.0, 3.0])
    np.testing.assert_array_equal(fill_gaps(np.full(3, np.nan)), np.zeros(3))
