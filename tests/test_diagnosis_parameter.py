"""Fitted parameters: transforms, the robot file's tolerances, the ranges of effects."""

import math

import numpy as np
import pytest

from exodrake.diagnosis.healthy import healthy_case, healthy_robot
from exodrake.diagnosis.parameter import Parameter, apply, effect_parameters, nominal_parameters
from exodrake.machines.library import machine_folders
from exodrake.machines.robot_file import load_robot

LAWS = {
    "relative": lambda base, x: base * (1.0 + x),
    "additive": lambda base, x: base + x,
    "log": lambda base, x: base * math.exp(x),
    "reciprocal": lambda base, x: 1.0 / x,
}


@pytest.fixture(scope="module")
def robot():
    return load_robot()


@pytest.mark.parametrize("transform", LAWS)
def test_transform_is_its_formula_and_its_inverse_undoes_it(transform):
    parameter = Parameter("p", (0,), transform, 2.5, 0.1, (-1.0, 1.0))
    for x in (0.02, 0.3, 0.9):
        assert parameter.value(x) == pytest.approx(LAWS[transform](2.5, x), rel=1e-14)
        assert parameter.coordinate(parameter.value(x)) == pytest.approx(x, rel=1e-12)


def test_nominal_parameters_start_from_the_robots_values(robot):
    parameters = nominal_parameters(robot)
    assert np.array_equal(apply(robot.values, parameters, np.zeros(len(parameters))), robot.values)
    stiffness = [p.name for p in parameters].index("finger.kappa.PIP")
    moved = apply(robot.values, parameters, 0.1 * np.eye(len(parameters))[stiffness])
    assert moved[robot.machine.index["finger.kappa.PIP"]] == pytest.approx(1.1 * robot["finger.kappa.PIP"])
    assert np.sum(moved != robot.values) == 1


@pytest.mark.parametrize("name", machine_folders())
def test_effects_at_null_coordinates_leave_the_robot_as_it_is(name):
    """x = 0 of an amplitude is its null value, and lies within the bounds of the fit, as the start does."""
    machine = load_robot(name).machine
    for effect in machine.effects:
        parameters = effect_parameters(machine, effect)
        assert parameters, effect.id
        for p in parameters:
            low, high = p.bounds
            assert low <= p.start <= high and p.scale > 0.0
            if p.amplitude:
                assert low <= 0.0 <= high
                assert p.value(0.0) == effect.parameters[0].null


def test_healthy_robots_differ_within_tolerance_and_have_no_effect(robot):
    assert [item.role for item in healthy_case(robot, 5).logs] == ["fit", "fit", "fit", "holdout"]
    drawn = np.array([healthy_robot(robot, np.random.default_rng(seed)).values for seed in range(200)])
    parameters = nominal_parameters(robot)
    fitted = sorted(i for p in parameters for i in p.index)
    assert (np.delete(drawn, fitted, axis=1) == np.delete(robot.values, fitted)).all()
    stiffness = next(p for p in parameters if p.name == "finger.kappa.PIP")
    ratio = drawn[:, stiffness.index[0]] / robot.values[stiffness.index[0]] - 1.0
    assert ratio.std() == pytest.approx(stiffness.prior_std, rel=0.2)
    assert np.abs(ratio).max() <= stiffness.bounds[1] + 1e-12
