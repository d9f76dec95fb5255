"""The linear model: closed forms of Bayesian linear regression, and evidence against scipy's normal density."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from exodrake.diagnosis.linear import LinearModel

WIDE = np.full(4, 1e6)


def model_of(jacobian, residual, precision, blocks=4, variance=1.0, memory=1.0, bounds=(-WIDE, WIDE)):
    """A model of one view in blocks of time, each a log of its own; a given noise variance."""
    count, samples = len(precision), len(residual)
    ends = np.linspace(0, samples, blocks + 1).astype(int)
    places = [(0, k, slice(int(a), int(b))) for k, (a, b) in enumerate(itertools.pairwise(ends))]
    low, high = (end[:count] for end in bounds)
    rows = np.vstack([jacobian, residual])
    found = LinearModel.of_rows(rows, places, (np.zeros(count), precision, low, high), memory)
    return replace(found, variance=np.array([variance]))


def example(seed=0, count=4, samples=200):
    rng = np.random.default_rng(seed)
    jacobian, x = rng.standard_normal((count, samples)), rng.standard_normal(count)
    return jacobian, -x @ jacobian + rng.standard_normal(samples), x


def test_posterior_is_that_of_bayesian_linear_regression():
    jacobian, residual, _ = example()
    precision, variance = np.array([0.5, 1.0, 2.0, 4.0]), 1.7
    found = model_of(jacobian, residual, precision, variance=variance).posterior()
    normal = jacobian @ jacobian.T / variance + np.diag(precision)
    assert found.step == pytest.approx(-np.linalg.solve(normal, jacobian @ residual / variance), rel=1e-6)
    assert found.covariance == pytest.approx(np.linalg.inv(normal), rel=1e-6)
    small = np.full(4, 0.1)
    within = model_of(jacobian, residual, precision, bounds=(-small, small)).posterior().step
    assert np.abs(within).max() <= 0.1 + 1e-9 < np.abs(found.step).max()


def test_evidence_is_the_marginal_density_of_the_residual():
    """Differences of log evidence are those of the normal density with the parameters integrated out."""
    jacobian, residual, _ = example(1)
    precision = np.array([0.5, 1.0, 2.0, 4.0])
    found = []
    for used in (slice(0, 2), slice(0, 4)):
        j, p = jacobian[used], precision[used]
        covariance = np.eye(len(residual)) + j.T @ np.diag(1.0 / p) @ j
        density = multivariate_normal(np.zeros(len(residual)), covariance).logpdf(residual)
        found.append((model_of(j, residual, p).evidence(), density))
    assert found[1][0] - found[0][0] == pytest.approx(found[1][1] - found[0][1], rel=1e-6)


def test_samples_that_count_as_one_divide_what_the_logs_say():
    jacobian, residual, _ = example(3)
    precision = np.full(4, 1e-6)
    one, many = (model_of(jacobian, residual, precision, memory=m).posterior() for m in (1.0, 25.0))
    assert np.sqrt(np.diag(many.covariance)) == pytest.approx(5.0 * np.sqrt(np.diag(one.covariance)), rel=1e-3)
    assert many.step == pytest.approx(one.step, rel=1e-3)


def test_a_block_left_out_counts_no_more():
    jacobian, residual, _ = example(4)
    precision = np.full(4, 0.1)
    found = model_of(jacobian, residual, precision)
    some = model_of(jacobian[:, 50:150], residual[50:150], precision, blocks=2).posterior()
    kept = found.posterior(np.isin(found.log, [1, 2]))
    assert kept.step == pytest.approx(some.step) and kept.covariance == pytest.approx(some.covariance)


def test_eliminated_parameters_leave_the_cost_of_the_others():
    """The minimum over the first two, at any value of the others, is a quadratic with the same minimiser."""
    jacobian, residual, _ = example(5)
    found = model_of(jacobian, residual, np.array([0.5, 1.0, 0.0, 0.0]) + 1e-12)
    reduced = found.eliminate(2)
    f = -np.linalg.solve(reduced.normal, reduced.slope)
    step = found.posterior().step
    assert f == pytest.approx(step[2:], rel=1e-5)
    assert reduced.others(np.array([0, 1]), f) == pytest.approx(step[:2], rel=1e-5)


def test_views_are_weighted_by_what_they_leave():
    """Two views of one parameter: weighted least squares with each view's own variance."""
    rng = np.random.default_rng(9)
    jacobian, noise = rng.standard_normal(400), rng.standard_normal(400) * np.repeat([2.0, 5.0], 200)
    rows = np.vstack([jacobian, noise - 0.3 * jacobian])
    places = [(0, 0, slice(0, 200)), (1, 0, slice(200, 400))]
    prior = [np.array([x]) for x in (0.0, 1e-9, -1e6, 1e6)]
    model = LinearModel.of_rows(rows, places, prior, 1.0)
    weights = 1.0 / np.repeat([np.mean(rows[1, :200] ** 2), np.mean(rows[1, 200:] ** 2)], 200)
    wanted = -np.sum(weights * rows[0] * rows[1]) / np.sum(weights * rows[0] ** 2)
    assert model.posterior().step == pytest.approx([wanted], rel=1e-6)


def test_robust_intervals_cover_where_the_model_errs_in_each_stretch_in_another_way():
    """A sinusoid of random phase is left in each stretch: 90 % intervals cover 90 %, the posterior half of that."""
    rng, covered = np.random.default_rng(5), []
    stretches, frames, x = 40, 50, np.array([1.0, -2.0])
    time = np.arange(frames) / frames
    for _ in range(300):
        jacobian = np.repeat(rng.standard_normal((2, stretches)), frames, axis=1) + 0.3
        left = np.concatenate([3.0 * np.sin(2.0 * time + phase) for phase in rng.uniform(0.0, 2.0 * np.pi, stretches)])
        residual = left + rng.standard_normal(stretches * frames) - x @ jacobian
        known = model_of(jacobian, residual, np.full(2, 1e-6), blocks=stretches)
        step = known.posterior().step
        fit = replace(
            model_of(jacobian, residual + step @ jacobian, np.full(2, 1e-6), blocks=stretches),
            variance=np.array([np.mean((residual + step @ jacobian) ** 2)]),
        )
        stds = [np.sqrt(np.diag(c)) for c in (fit.robust_covariance(), fit.posterior().covariance)]
        covered.append([np.abs(step - x) < 1.645 * std for std in stds])
    robust, plain = np.mean(covered, axis=(0, 2))
    assert 0.85 < robust < 0.95 and plain < 0.6


def test_robust_covariance_is_that_of_the_posterior_where_nothing_is_left_but_noise():
    jacobian, residual, _ = example(6, samples=4_000)
    model = model_of(jacobian, residual, np.full(4, 1e-3), blocks=40)
    at_fit = model_of(jacobian, residual + model.posterior().step @ jacobian, np.full(4, 1e-3), blocks=40)
    wider = np.diag(at_fit.robust_covariance()) / np.diag(at_fit.posterior().covariance)
    assert np.all(wider >= 1.0 - 1e-12) and np.all(wider < 2.0)
