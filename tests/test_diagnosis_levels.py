"""Levels: error rates of the tests on draws from their null and on injected errors, and scipy's distributions."""

import numpy as np
import pytest
from formula_case import FRAME, explanation, likelihood_of, linearisation, nominal, probe
from scipy import stats

from exodrake.core.confidence import ALPHA
from exodrake.diagnosis import levels as method
from exodrake.diagnosis.comparison import excess, taken_up
from exodrake.diagnosis.likelihood import CORRELATION
from exodrake.diagnosis.noise import INDEPENDENT
from exodrake.diagnosis.p_values import exceeding, exceeding_any
from exodrake.diagnosis.projection import Projection
from exodrake.diagnosis.scan import local_levels, scan

FRAMES, NOMINAL, CASES = 400, 3, 200


def levels(seed, extra=0.0):
    """Levels of the nominal robot, fitted, on white noise and so much of a direction that an effect may add."""
    rng = np.random.default_rng(seed)
    jacobian, directions = rng.standard_normal((NOMINAL, FRAMES)), rng.standard_normal((4, FRAMES))
    strength = np.exp(rng.normal(0.0, 1.0 / np.sqrt(2.0 * INDEPENDENT * FRAMES)))  # noise is known to this precision
    measured = strength * rng.standard_normal(FRAMES) + extra * directions[2]
    fit = np.linalg.lstsq(jacobian.T, -measured)[0]
    runs = tuple([rng.standard_normal((FRAMES, 1))] for _ in range(4))
    likelihood = likelihood_of(lambda row: measured + row[:NOMINAL] @ jacobian, noise=runs)
    e = explanation(likelihood, nominal(NOMINAL, 10.0), fit, jacobian)
    lin = linearisation(e, directions, [probe(f"effect {k}", (k,)) for k in range(4)])
    return method.Tests(likelihood, lin, np.zeros(FRAMES))(e)


@pytest.fixture(scope="module")
def null():
    return [levels(seed) for seed in range(CASES)]


def test_smallest_p_value_of_a_fit_to_noise_is_uniform(null):
    """Whole and view by view, which are tested jointly: their smallest has the level of one."""
    assert stats.kstest([min(item.fit, *item.views) for item in null], "uniform").pvalue > 0.01


@pytest.mark.parametrize("name", ["local", "complete"])
def test_a_test_rejects_noise_about_as_often_as_its_level_says(null, name):
    """Log-normal tails of 99 draws, and the better of two statistics: the level holds within a factor of 2."""
    for level in (0.1, 0.2):
        rejected = sum(getattr(item, name) < level for item in null)
        assert 0.4 * level * CASES < rejected < 1.6 * level * CASES


def test_nominal_robot_without_a_gap_is_kept(null):
    assert np.mean([item.kept for item in null]) > 1.0 - 3.0 * ALPHA
    assert all(item.beaten_by == "" and item.law_error >= 0.0 for item in null)


def test_injected_effect_is_rejected_and_named_as_the_next_one():
    """Half a standard deviation in every sample: a gain of 100 in chi-square, where one of 8 has a level of 2 %."""
    found = [levels(seed, extra=0.5) for seed in range(20)]
    assert all(item.complete < ALPHA and item.next_effect == "effect 2" for item in found)
    assert not any(item.sufficient for item in found)


def test_large_error_is_rejected_by_the_fit():
    assert all(levels(seed, extra=1.5).fit < ALPHA for seed in range(5))


def test_retuned_robots_of_the_tolerances_have_the_covariance_of_bayesian_regression():
    """Estimates (J'J + P)^-1 J'(J x + w) of x ~ N(0, P^-1) in white noise w: covariance (J'J + P)^-1 J'J P^-1."""
    rng = np.random.default_rng(4)
    jacobian, prior = 0.1 * rng.standard_normal((NOMINAL, FRAMES)), 0.5
    likelihood = likelihood_of(lambda row: row[:NOMINAL] @ jacobian)
    e = explanation(likelihood, nominal(NOMINAL, prior), np.zeros(NOMINAL), jacobian)
    project = Projection(likelihood, e, linearisation(e, rng.standard_normal((1, FRAMES)), [probe("effect", (0,))]))
    noise = rng.standard_normal((20_000, FRAMES)) / likelihood.weights
    found, gram = (
        np.cov(project.retuned(noise, rng)),
        (jacobian * likelihood.weights) @ (jacobian * likelihood.weights).T,
    )
    np.testing.assert_allclose(found, np.linalg.inv(gram + np.eye(NOMINAL) / prior**2) @ gram * prior**2, atol=0.01)


def test_exceeding_is_the_tail_of_scipys_log_normal():
    draws = np.random.default_rng(1).lognormal(1.0, 0.3, 200_000)
    for quantile in (0.5, 0.1, 1e-3):
        value = float(stats.lognorm.isf(quantile, 0.3, scale=np.e))
        assert exceeding(draws, value) == pytest.approx(quantile, rel=0.05)
    assert exceeding(draws, 1e9) < 1e-30  # smaller than 1 / draws


@pytest.mark.parametrize("shared", [0.0, 0.7, 1.0])
def test_smallest_of_several_p_values_keeps_its_level(shared):
    """Three statistics, apart, half alike and equal; apart, single p-values reject three times as often."""
    rng, p = np.random.default_rng(3), []
    for _ in range(400):
        z = np.sqrt(shared) * rng.standard_normal(100) + np.sqrt(1.0 - shared) * rng.standard_normal((3, 100))
        *draws, values = *np.exp(0.1 * z[:, 1:]), np.exp(0.1 * z[:, 0])
        p.append((min(exceeding_any(draws, values)), min(map(exceeding, draws, values))))
    found, single = np.transpose(p)
    assert stats.kstest(found, "uniform").pvalue > 0.01
    assert np.all(found >= single * (1.0 - 1e-9))
    assert shared > 0.0 or np.mean(single < 0.1) > 2.0 * np.mean(found < 0.1)


def burst(white, size=5.0):
    white[:, 500:650, 3] += size * np.random.default_rng(9).standard_normal(150)
    return white


def bias(white, size=0.3):
    return white + size


@pytest.mark.parametrize(("injected", "statistic"), [(burst, 0), (bias, 1)])
def test_scan_sees_a_burst_of_three_seconds_and_a_small_constant_bias(injected, statistic):
    """20 s of 12 columns: the burst adds 14 % to the whole sum of squares, the bias 9 %."""
    frames, columns, rng = round(20.0 / FRAME), 12, np.random.default_rng(7)
    likelihood = likelihood_of(lambda row: row, (frames, frames), columns)

    def scanned(rows, change=lambda white: white):
        white = rng.standard_normal((rows, 2, frames, columns))
        white[:, 0] = change(white[:, 0])
        return scan(likelihood, white.reshape(rows, -1))

    draws = scanned(99)
    assert local_levels(draws, scanned(1, injected))[statistic] < 1e-4
    healthy = np.array([local_levels(draws, scanned(1)) for _ in range(40)])
    assert np.mean(healthy.min(axis=1) < ALPHA) < 0.15


@pytest.mark.parametrize("begins", [0.0, 9.5, 20.0])
def test_scan_sees_a_burst_wherever_it_lies(begins):
    """A second of ten: at the start, across windows and after the last whole one of a log of 21 s."""
    frames, second = round(21.0 / FRAME), round(1.0 / FRAME)
    first = round(begins / FRAME)
    log = np.zeros((1, frames, 2))
    log[0, first : first + second] = 10.0
    ((power, _),) = scan(likelihood_of(lambda row: row, (frames,), 2), log.reshape(1, -1))
    assert power == pytest.approx(50.0, rel=0.03)  # half a window of 100


def test_rival_takes_up_its_share_of_the_excess_over_noise():
    """A leaves 5 and B leaves 2 times the noise, and they use 25 and 4 of their prior, in independent samples."""
    likelihood = likelihood_of(lambda row: np.full(FRAMES, np.sqrt(row[0])))
    a, b = (explanation(likelihood, nominal(1, 1.0), np.array([x]), np.zeros((1, FRAMES))) for x in (5.0, 2.0))
    samples = FRAMES * FRAME / CORRELATION / 5.0  # in units of what A leaves
    found = taken_up(likelihood, a, b)
    assert found.power == pytest.approx(3.0 * samples)
    assert found.share == pytest.approx((3.0 * samples + 21.0) / (4.0 * samples + 25.0))
    assert taken_up(likelihood, b, a).share < 0.0


def test_a_view_that_leaves_less_than_noise_makes_up_for_no_use_of_tolerances():
    """As where sensors are quieter than the robot file says: half of the noise is left, and 25 of the prior used."""
    likelihood = likelihood_of(lambda row: np.full(FRAMES, np.sqrt(0.5))).scaled_to(np.ones(FRAMES))
    e = explanation(likelihood, nominal(1, 1.0), np.array([5.0]), np.zeros((1, FRAMES)))
    assert 2.0 * e.cost(likelihood) < 25.0 + FRAMES * FRAME / CORRELATION
    assert excess(likelihood, e) == pytest.approx(25.0)
