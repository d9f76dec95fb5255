"""Closure: closed forms, the identity of its two steps, and intervals."""

import numpy as np
import pytest
from diagnosis_cases import friction_diagnosis

from exodrake.core.confidence import CONFIDENCE
from exodrake.diagnosis.closure import blocks, bootstrapped, closure


@pytest.mark.parametrize(
    ("before", "after", "value"), [(5.0, 1.0, 1.0), (5.0, 3.0, 0.5), (5.0, 5.0, 0.0), (3.0, 5.0, -1.0)]
)
def test_closure_of_known_gaps(before, after, value):
    assert closure(np.array([before]), np.array([after])) == pytest.approx(value)


def test_gap_within_noise_has_no_closure():
    assert np.isnan(closure(np.array([0.98]), np.array([0.9])))
    assert np.isnan(bootstrapped(np.full(5, 0.9), np.full(5, 0.8), np.ones(5), np.zeros((10, 5), dtype=int)).value)


def test_two_steps_multiply_to_the_whole():
    """(1 - C_overall) = (1 - C_retune) (1 - C_effect) wherever each robot leaves more than noise."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        nominal, retuned, improved = (scale + rng.exponential(scale, 30) for scale in (40.0, 8.0, 2.0))
        whole, first, second = (
            closure(*pair) for pair in ((nominal, improved), (nominal, retuned), (retuned, improved))
        )
        assert 1.0 - whole == pytest.approx((1.0 - first) * (1.0 - second), rel=1e-12)


def test_two_steps_of_a_diagnosis_multiply_to_the_whole():
    found = friction_diagnosis().closure
    assert 1.0 - found.overall.value == pytest.approx((1.0 - found.retune.value) * (1.0 - found.effect.value), abs=1e-9)
    assert found.effect.value > 0.8


def test_bootstrap_interval_covers_the_truth_as_often_as_it_says():
    """Blocks of exponential mean squares: the truth is 1 - (2 - 1) / (10 - 1)."""
    rng, truth, hits = np.random.default_rng(1), 1.0 - 1.0 / 9.0, 0
    for _ in range(200):
        before, after = 10.0 * rng.gamma(5.0, 0.2, 40), 2.0 * rng.gamma(5.0, 0.2, 40)
        found = bootstrapped(before, after, np.ones(40), rng.integers(0, 40, (200, 40)))
        hits += found.low <= truth <= found.high
    assert CONFIDENCE - 0.07 < hits / 200 < CONFIDENCE + 0.06


def test_blocks_are_mean_squares_of_all_measured_samples_of_each_log():
    logs = [np.repeat([1.0, 2.0, 9.0], [4, 4, 2])[:, None], np.full((4, 1), 3.0), np.full((3, 1), np.nan)]
    logs[1][1] = np.nan
    means, samples = blocks(logs, 4)
    assert means == pytest.approx([1.0, 4.0, 81.0, 9.0]) and samples.tolist() == [4, 4, 2, 3]
    assert np.average(means, weights=samples) == pytest.approx(np.nanmean(np.concatenate(logs) ** 2))


@pytest.mark.parametrize("missing", [0.0, 0.2, 0.5])
def test_missing_samples_do_not_count_as_perfect_ones(missing):
    """Gaps of 2 and 0.5 noise variances: closure 0.75, however many samples are missing."""
    rng = np.random.default_rng(0)
    logs = [[np.sqrt(1.0 + gap) * rng.standard_normal((20_000, 2))] for gap in (2.0, 0.5)]
    lost = rng.random((20_000, 2)) < missing
    (before, samples), (after, _) = (blocks([np.where(lost, np.nan, log[0])], 100) for log in logs)
    assert closure(before, after, samples) == pytest.approx(0.75, abs=0.02)
