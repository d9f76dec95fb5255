"""Closure: closed forms, the identity of its two steps, intervals, and robots fitted to the other logs."""

from types import SimpleNamespace

import numpy as np
import pytest
from formula_case import explanation, likelihood_of, nominal

from exodrake.core.confidence import CONFIDENCE
from exodrake.diagnosis.closure import blocks, bootstrap, closure, kinds_of_motion, without_logs
from exodrake.diagnosis.fit import linear_model
from exodrake.diagnosis.search import Fitted

FRAMES, PRIOR = (120, 80, 200), 0.5


def test_closure_of_known_gaps():
    """Within noise there is none; (1 - C_overall) = (1 - C_retune) (1 - C_effect) where each robot leaves more."""
    for before, after, value in ((5.0, 1.0, 1.0), (5.0, 3.0, 0.5), (5.0, 5.0, 0.0), (3.0, 5.0, -1.0)):
        assert closure(np.array([before]), np.array([after])) == pytest.approx(value)
    assert np.isnan(closure(np.array([0.98]), np.array([0.9])))
    assert np.isnan(bootstrap(np.full(5, 0.9), np.full(5, 0.8), np.ones(5), np.zeros((10, 5), dtype=int)).value)
    rng = np.random.default_rng(0)
    nominal, retuned, improved = (scale + rng.exponential(scale, 30) for scale in (40.0, 8.0, 2.0))
    whole, first, second = (closure(*pair) for pair in ((nominal, improved), (nominal, retuned), (retuned, improved)))
    assert 1.0 - whole == pytest.approx((1.0 - first) * (1.0 - second), rel=1e-12)


def test_bootstrap_interval_covers_the_truth_as_often_as_it_says():
    """Blocks of exponential mean squares: the truth is 1 - (2 - 1) / (10 - 1)."""
    rng, truth, hits = np.random.default_rng(1), 1.0 - 1.0 / 9.0, 0
    for _ in range(200):
        before, after = 10.0 * rng.gamma(5.0, 0.2, 40), 2.0 * rng.gamma(5.0, 0.2, 40)
        found = bootstrap(before, after, np.ones(40), rng.integers(0, 40, (200, 40)))
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


def test_robot_without_a_log_is_that_fitted_to_the_others():
    """For a linear model the one Gauss-Newton step is the whole fit."""
    rng = np.random.default_rng(3)
    jacobian, offset = rng.standard_normal((4, sum(FRAMES))), rng.standard_normal(sum(FRAMES))
    likelihood = likelihood_of(lambda row: offset + row[:4] @ jacobian, FRAMES)
    fit = -np.linalg.solve(jacobian @ jacobian.T + np.eye(4) / PRIOR**2, jacobian @ offset)
    e = explanation(likelihood, nominal(4, PRIOR), fit, jacobian)
    model = linear_model(likelihood.scaled_to(e.residual), e)
    fitted, weight = Fitted(e, model, likelihood.chi2(e.residual), 1.0, np.zeros(1)), 1.0 / float(model.variance[0])
    starts = np.cumsum((0, *FRAMES))
    for k in range(3):
        kept = np.ones(sum(FRAMES), dtype=bool)
        kept[starts[k] : starts[k + 1]] = False
        normal = weight * jacobian[:, kept] @ jacobian[:, kept].T + np.eye(4) / PRIOR**2
        expected = -np.linalg.solve(normal, weight * jacobian[:, kept] @ offset[kept])
        assert without_logs(fitted, [k])[:4] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("protocol", "kind"), [("sweeps_2", "sweeps"), ("chirp", "chirp"), ("random-10", "random"), ("12", "12")]
)
def test_runs_of_a_motion_are_one_kind(protocol, kind):
    case = SimpleNamespace(logs=[SimpleNamespace(file="a.csv", protocol=protocol)])
    problem = SimpleNamespace(case=case, fit=(SimpleNamespace(name="a.csv"),), holdout=())
    assert kinds_of_motion(problem) == {"a.csv": kind}
