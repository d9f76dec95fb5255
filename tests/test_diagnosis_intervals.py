"""Intervals: those of a linear fit in closed form, coverage, affected channels, traces, units and ranges."""

from dataclasses import replace

import numpy as np
import pytest
from formula_case import amplitude, explanation, likelihood_of, nominal
from scipy.optimize import least_squares

from exodrake.core.confidence import NORMAL_90
from exodrake.diagnosis.fit import linear_model
from exodrake.diagnosis.intervals import (
    ROUNDING,
    Estimates,
    affected_channels,
    describe,
    fitted_effects,
    interval,
    pool_channels,
    traces,
)
from exodrake.diagnosis.parameter import effect_parameters
from exodrake.diagnosis.search import Fitted
from exodrake.machines.robot_file import load_robot
from exodrake.model.effect import ANY_SHAPE, LAW_STD, SHAPE_STD


@pytest.fixture(scope="module")
def machine():
    return load_robot().machine


def fitted(machine, effect, x, std):
    parameters = effect_parameters(machine, machine.effect(effect))
    return Estimates(parameters, np.array(x, dtype=float), np.diag(np.square(np.broadcast_to(std, len(parameters)))))


def test_intervals_of_normal_estimates_cover_as_often_as_they_say(machine):
    parameter = replace(effect_parameters(machine, machine.effect("mocap.gain"))[0])
    rng, truth, std = np.random.default_rng(0), 0.05, 0.02
    found = [interval(parameter, truth + std * rng.standard_normal(), std, "-") for _ in range(2000)]
    assert np.mean([item.low <= truth <= item.high for item in found]) == pytest.approx(0.9, abs=0.025)


DRAWS = 400


def share_found(amplitudes, std):
    """Share of draws of normal estimates in which exactly the channels with an amplitude are found."""
    rng, amplitudes, std = np.random.default_rng(0), np.array(amplitudes), np.broadcast_to(std, len(amplitudes))
    draws = amplitudes + std * rng.standard_normal((DRAWS, len(amplitudes)))
    return np.mean([np.array_equal(affected_channels(x, np.diag(std**2)), np.flatnonzero(amplitudes)) for x in draws])


@pytest.mark.parametrize("amplitudes", [[1.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 0.9], [0, 0, 1.0, 0], [1.0] * 6])
def test_channels_with_an_amplitude_are_found(amplitudes):
    assert share_found(amplitudes, 0.05) > 0.98 and share_found(amplitudes, 0.2) > 0.9


def test_a_channel_that_the_motion_hardly_excites_goes_with_the_others_unless_its_amplitude_ended_at_0():
    assert share_found([1.0, 1.0, 1.0], [0.05, 1.0, 0.05]) > 0.9 and share_found([1.0, 0, 0], [0.05, 1.0, 0.05]) > 0.9
    assert affected_channels(np.array([0.05, 0.0, 0.05]), np.diag([0.003, 50.0, 0.003]) ** 2).tolist() == [0, 2]
    assert len(affected_channels(np.zeros(3), np.eye(3))) == 1


def test_the_set_of_channels_depends_on_neither_scale_nor_order():
    rng = np.random.default_rng(1)
    for _ in range(50):
        x, root = rng.standard_normal(4), 0.3 * rng.standard_normal((4, 4))
        covariance, order = root @ root.T, rng.permutation(4)
        found = set(affected_channels(x, covariance))
        assert set(affected_channels(1e-6 * x, 1e-12 * covariance)) == found
        assert {order[i] for i in affected_channels(x[order], covariance[np.ix_(order, order)])} == found


def test_answer_names_the_channels_and_pools_them_unless_they_clearly_differ(machine):
    effect = machine.effect("mocap.gain")
    found = describe(fitted(machine, "mocap.gain", [0.1, 0.12, 0.0], 0.01), effect, machine.axes.joints)
    assert found.joints == ("MCP", "PIP") and found.wires == () and found.kind == "gain"
    assert found.parameters["gain"].value == pytest.approx(0.11) and set(found.channels["gain"]) == {"MCP", "PIP"}
    found = describe(fitted(machine, "mocap.gain", [0.1, 0.12, 0.0], 1e-3), effect, machine.axes.joints)
    assert np.isnan(found.parameters["gain"].value) and found.parameters["gain"].unit == "-"
    assert {c: round(i.value, 6) for c, i in found.channels["gain"].items()} == {"MCP": 0.1, "PIP": 0.12}


def test_a_small_amplitude_where_an_effect_does_not_sit_is_a_trace_if_its_interval_holds_0(machine):
    effect = machine.effect("mocap.gain")
    at = list(machine.effect_indices("mocap.gain", "gain").values())
    for small, left in ((0.001, {at[2]: 0.0}), (0.005, {})):
        found = fitted(machine, "mocap.gain", [0.1, 0.1, small], 0.002)
        named = describe(found, effect, machine.axes.joints)
        assert named.joints == ("MCP", "PIP") and traces((named,), found) == left


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
    parameter = effect_parameters(machine, machine.effect("motor.slow_velocity_loop"))[0]
    x = parameter.coordinate(0.9)
    found = interval(parameter, x, 0.0, "-", LAW_STD)
    assert np.log([found.low, found.high]) == pytest.approx(x + NORMAL_90 * LAW_STD * x * np.array([1.0, -1.0]))


def test_pitch_is_reported_near_palm_down_or_palm_up(machine):
    effect = machine.effect("finger.gravity")
    parameters = effect_parameters(machine, effect)
    at = next(i for i, p in enumerate(parameters) if p.name == "finger.gravity.pitch")
    for stated, value in ((-0.2, -0.2), (3.3, 3.3 - 2 * np.pi), (3.0, 3.0)):
        x = [p.start for p in parameters]
        x[at] = parameters[at].coordinate(value)
        found = describe(fitted(machine, effect.id, x, 0.01), effect, machine.axes.joints).parameters["pitch"]
        assert found.value == pytest.approx(stated) and found.low < stated < found.high


def test_no_interval_goes_where_a_parameter_has_no_meaning(machine):
    """Friction does not drive a wire on, and a garment more yielding than none at all would push."""
    for effect, unknown in (("tendon.coulomb_friction", "force"), ("tendon.compliance", "stiffness")):
        parameter = effect_parameters(machine, machine.effect(effect))[0]
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
    parameters = effect_parameters(machine, machine.effect(effect))
    at = next(p for p in parameters if p.name == f"{effect}.{parameter}")
    x = [0.5 if at.transform == "log" else 0.1 if at.amplitude else at.start] * len(parameters)
    found = describe(fitted(machine, effect, x, 1e-9), machine.effect(effect), machine.axes.tendons)
    stated = found.parameters[parameter]
    log = at.transform == "log"
    width = np.log(stated.high / stated.low) if log else (stated.high - stated.low) / stated.value
    assert width / 2 == pytest.approx(NORMAL_90 * std, rel=1e-3)
