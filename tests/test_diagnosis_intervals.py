"""The linear model and its intervals: Bayesian regression in closed form, coverage, affected channels, units."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from formula_case import amplitude, explanation, likelihood_of, nominal
from scipy.optimize import least_squares
from scipy.stats import multivariate_normal

from exodrake.core.confidence import NORMAL_90
from exodrake.diagnosis.fit import linear_model
from exodrake.diagnosis.intervals import (
    ROUNDING,
    Estimates,
    affected_channels,
    describe,
    find_traces,
    fitted_effects,
    interval,
    pool_channels,
)
from exodrake.diagnosis.linear import LinearModel
from exodrake.diagnosis.parameter import effect_parameters
from exodrake.diagnosis.search import Fitted
from exodrake.machines.robot_file import load_robot
from exodrake.model.effect import ANY_SHAPE, LAW_STD, SHAPE_STD

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


@pytest.fixture(scope="module")
def machine():
    return load_robot().machine


def fitted(machine, effect, x, std):
    parameters = effect_parameters(load_robot(), machine.effect(effect))
    covariance = np.diag(np.square(np.broadcast_to(std, len(parameters))))
    return Estimates(parameters, np.array(x, dtype=float), covariance, np.ones(len(parameters)))


def test_intervals_of_normal_estimates_cover_as_often_as_they_say(machine):
    parameter = replace(effect_parameters(load_robot(), machine.effect("mocap.gain"))[0])
    rng, truth, std = np.random.default_rng(0), 0.05, 0.02
    found = [interval(parameter, truth + std * rng.standard_normal(), std, "-") for _ in range(2000)]
    assert np.mean([item.low <= truth <= item.high for item in found]) == pytest.approx(0.9, abs=0.025)


DRAWS = 400


def share_found(amplitudes, std):
    """Share of draws of normal estimates in which exactly the channels with an amplitude are found."""
    rng, amplitudes, std = np.random.default_rng(0), np.array(amplitudes), np.broadcast_to(std, len(amplitudes))
    draws = amplitudes + std * rng.standard_normal((DRAWS, len(amplitudes)))
    found = [affected_channels(x, np.diag(std**2), 1.0 / std) for x in draws]
    return np.mean([np.array_equal(one, np.flatnonzero(amplitudes)) for one in found])


@pytest.mark.parametrize("amplitudes", [[1.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 0.9], [0, 0, 1.0, 0], [1.0] * 6])
def test_channels_with_an_amplitude_are_found(amplitudes):
    assert share_found(amplitudes, 0.05) > 0.98 and share_found(amplitudes, 0.2) > 0.9


def test_a_channel_that_the_motion_hardly_excites_goes_with_the_others_unless_its_amplitude_ended_at_0():
    assert share_found([1.0, 1.0, 1.0], [0.05, 1.0, 0.05]) > 0.9 and share_found([1.0, 0, 0], [0.05, 1.0, 0.05]) > 0.9
    x, std = np.array([0.05, 0.0, 0.05]), np.array([0.003, 50.0, 0.003])
    assert affected_channels(x, np.diag(std**2), np.ones(3)).tolist() == [0, 2]
    assert len(affected_channels(np.zeros(3), np.eye(3), np.ones(3))) == 1


def test_a_smaller_amplitude_counts_where_its_channel_shows_it_as_clearly():
    """Dry friction of a six-joint arm [N m], as large in each joint's efforts as the joint is loaded."""
    friction, error = np.array([6.7, 6.5, 4.1, 1.5, 1.3, 0.6]), np.array([0.05, 0.05, 0.03, 0.01, 0.007, 0.005])
    assert affected_channels(friction, np.diag(error**2), 1.0 / error).tolist() == [0, 1, 2, 3, 4, 5]
    assert 5 not in affected_channels(friction, np.diag(error**2), np.ones(6))


def test_the_set_of_channels_depends_on_neither_scale_nor_order():
    rng = np.random.default_rng(1)
    for _ in range(50):
        x, root = rng.standard_normal(4), 0.3 * rng.standard_normal((4, 4))
        covariance, order = root @ root.T, rng.permutation(4)
        shown = rng.uniform(1.0, 10.0, 4)
        found = set(affected_channels(x, covariance, shown))
        assert set(affected_channels(1e-6 * x, 1e-12 * covariance, 1e6 * shown)) == found
        assert set(affected_channels(x, covariance, 3.0 * shown)) == found
        assert {order[i] for i in affected_channels(x[order], covariance[np.ix_(order, order)], shown[order])} == found


def test_answer_names_the_channels_and_pools_them_unless_they_clearly_differ(machine):
    effect = machine.effect("mocap.gain")
    found = describe(fitted(machine, "mocap.gain", [0.1, 0.12, 0.0], 0.01), effect, machine.axes.joints)
    assert found.joints == ("MCP", "PIP") and found.wires == () and found.kind == "gain"
    assert found.parameters["gain"].value == pytest.approx(0.11) and set(found.channels["gain"]) == {"MCP", "PIP"}
    found = describe(fitted(machine, "mocap.gain", [0.1, 0.12, 0.0], 1e-3), effect, machine.axes.joints)
    assert np.isnan(found.parameters["gain"].value) and found.parameters["gain"].unit == "-"
    assert {c: round(i.value, 6) for c, i in found.channels["gain"].items()} == {"MCP": 0.1, "PIP": 0.12}


def test_a_small_amplitude_where_an_effect_does_not_sit_is_a_trace_if_its_interval_holds_0(machine):
    for small, left in ((0.001, [("DIP",)]), (0.005, [])):
        found = fitted(machine, "mocap.gain", [0.1, 0.1, small], 0.002)
        assert [p.channels for p in find_traces(found, machine)] == left


def test_an_effect_sits_on_no_channel_in_which_it_cannot_show(machine):
    """As a coupling to the joint before, of the first one."""
    found = fitted(machine, "mocap.gain", [0.1, 0.0, 0.1], 0.01)
    shown = np.array([1.0, 0.0, 1.0])
    blind = replace(found, covariance=np.diag([1e-4, 1.0, 1e-4]), shown=shown)
    assert describe(blind, machine.effect("mocap.gain"), machine.axes.joints).joints == ("MCP", "DIP")


def test_covariance_of_effects_that_meet_is_that_of_all_fitted_parameters_together():
    """Two effects and a nominal parameter with alike columns: scipy's curvature, times samples that count as one."""
    rng, memory, prior = np.random.default_rng(4), 3.0, 0.5
    common = rng.standard_normal(400)
    columns = common + 0.5 * rng.standard_normal((3, 400))
    noise = rng.standard_normal(400)
    likelihood = likelihood_of(lambda row: row @ columns + noise)
    parameters = (*nominal(1, prior), amplitude("a", 1), amplitude("b", 2))
    wanted = least_squares(lambda x: np.r_[x @ columns + noise, memory**0.5 * x[0] / prior], np.zeros(3))
    e = explanation(likelihood, parameters, wanted.x, columns[:1], ("a", "b"))
    model = linear_model(likelihood.scaled_to(e.residual), e)
    found = fitted_effects(Fitted(e, model, model.variance, memory, np.zeros(1)))
    normal = columns @ columns.T / (memory * model.variance[0]) + np.diag([prior**-2, 12.0 / 200**2, 12.0 / 200**2])
    assert found.covariance == pytest.approx(np.linalg.inv(normal)[1:, 1:], rel=1e-3)
    alone = fitted_effects(Fitted(e, model, model.variance, memory, np.zeros(1))).of("a")
    assert alone.std[0] == pytest.approx(found.std[0]) and [p.effect for p in alone.parameters] == ["a"]


@pytest.mark.parametrize("between", [0.0, 0.3])
def test_pooled_value_of_channels_that_differ_has_the_error_of_its_draws(between):
    """Own errors are correlated; where channels differ as well, that is part of their scatter, and counts once."""
    rng, own = np.random.default_rng(3), 0.04 * (0.5 * np.eye(3) + 0.5)
    values = rng.multivariate_normal(np.ones(3), own + between**2 * np.eye(3), 4000)
    found = np.array([pool_channels(row, own) for row in values])
    assert np.mean(found[:, 1] ** 2) == pytest.approx(np.var(found[:, 0]), rel=0.1 if between else 0.25)


def test_error_of_a_law_is_a_share_of_what_the_effect_does(machine):
    """A loop that is 10 % slower is known to 8 % of these 10 %, and one that is not slower does not exist."""
    parameter = effect_parameters(load_robot(), machine.effect("motor.slow_velocity_loop"))[0]
    x = parameter.coordinate(0.9)
    found = interval(parameter, x, 0.0, "-", LAW_STD)
    assert np.log([found.low, found.high]) == pytest.approx(x + NORMAL_90 * LAW_STD * x * np.array([1.0, -1.0]))


def test_pitch_is_reported_near_palm_down_or_palm_up(machine):
    effect = machine.effect("finger.gravity")
    parameters = effect_parameters(load_robot(), effect)
    at = next(i for i, p in enumerate(parameters) if p.name == "finger.gravity.pitch")
    for stated, value in ((-0.2, -0.2), (3.3, 3.3 - 2 * np.pi), (3.0, 3.0)):
        x = [p.start for p in parameters]
        x[at] = parameters[at].coordinate(value)
        found = describe(fitted(machine, effect.id, x, 0.01), effect, machine.axes.joints).parameters["pitch"]
        assert found.value == pytest.approx(stated) and found.low < stated < found.high


def test_no_interval_goes_where_a_parameter_has_no_meaning(machine):
    """Friction does not drive a wire on, and a garment more yielding than none at all would push."""
    for effect, unknown in (("tendon.coulomb_friction", "force"), ("tendon.compliance", "stiffness")):
        parameter = effect_parameters(load_robot(), machine.effect(effect))[0]
        assert parameter.name.endswith(unknown)
        found = interval(parameter, 0.1 * parameter.start, parameter.start, "")
        ends = sorted(parameter.value(b) for b in parameter.bounds)
        assert ends[0] <= found.low <= found.value <= found.high <= ends[1] and found.low >= 0.0
        assert parameter.value(0.0) in (found.low, found.high)


@pytest.mark.parametrize(
    ("effect", "parameter", "std"),
    [
        ("tendon.stribeck_friction", "force", LAW_STD),  # scales the friction
        ("tendon.stribeck_friction", "ratio", SHAPE_STD),
        ("tendon.creep", "time_constant", ANY_SHAPE),  # one for a spectrum
        ("sensor.gain", "gain", ROUNDING),  # means the same in every law
    ],
)
def test_parameter_without_noise_is_as_uncertain_as_its_meaning(machine, effect, parameter, std):
    parameters = effect_parameters(load_robot(), machine.effect(effect))
    at = next(p for p in parameters if p.name == f"{effect}.{parameter}")
    x = [0.5 if at.transform == "log" else 0.1 if at.amplitude else at.start] * len(parameters)
    found = describe(fitted(machine, effect, x, 1e-9), machine.effect(effect), machine.axes.tendons)
    stated = found.parameters[parameter]
    log = at.transform == "log"
    width = np.log(stated.high / stated.low) if log else (stated.high - stated.low) / stated.value
    assert width / 2 == pytest.approx(NORMAL_90 * std, rel=1e-3)
