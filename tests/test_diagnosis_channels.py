"""Affected channels: sets behind normal estimates are found again, whatever their scale and order."""

import numpy as np
import pytest

from exodrake.diagnosis.intervals import affected_channels

DRAWS = 400


def share_found(amplitudes, std, seed=0):
    """Share of draws of normal estimates in which exactly the channels with an amplitude are found."""
    rng, amplitudes, std = np.random.default_rng(seed), np.array(amplitudes), np.array(std)
    draws = amplitudes + std * rng.standard_normal((DRAWS, len(amplitudes)))
    return np.mean([np.array_equal(affected_channels(x, np.diag(std**2)), np.flatnonzero(amplitudes)) for x in draws])


@pytest.mark.parametrize("amplitudes", [[1.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 0.9], [0, 0, 1.0, 0], [1.0] * 6])
def test_channels_with_an_amplitude_are_found(amplitudes):
    assert share_found(amplitudes, [0.05] * len(amplitudes)) > 0.98
    assert share_found(amplitudes, [0.2] * len(amplitudes)) > 0.9


def test_a_channel_that_the_motion_hardly_excites_goes_with_the_others():
    assert share_found([1.0, 1.0, 1.0], [0.05, 1.0, 0.05]) > 0.9
    assert share_found([1.0, 0.0, 0.0], [0.05, 1.0, 0.05]) > 0.9


def test_the_set_depends_on_neither_scale_nor_order():
    rng = np.random.default_rng(1)
    for _ in range(50):
        x, root = rng.standard_normal(4), 0.3 * rng.standard_normal((4, 4))
        covariance, order = root @ root.T, rng.permutation(4)
        found = set(affected_channels(x, covariance))
        assert set(affected_channels(1e-6 * x, 1e-12 * covariance)) == found
        assert {order[i] for i in affected_channels(x[order], covariance[np.ix_(order, order)])} == found


def test_an_effect_without_any_amplitude_sits_somewhere():
    assert len(affected_channels(np.zeros(3), np.eye(3))) == 1
