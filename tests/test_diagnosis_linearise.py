"""Fitted parameters, their transforms and ranges; directions of effects and derivatives against closed forms."""

import math

import numpy as np
import pytest
from diagnosis_cases import friction_problem

from exodrake.diagnosis.calibrate import healthy_case
from exodrake.diagnosis.fit import Explanation
from exodrake.diagnosis.likelihood import output_error
from exodrake.diagnosis.linearise import PROBE, linearise, nominal_jacobian, probes, scaled_points
from exodrake.diagnosis.parameter import Parameter, apply, effect_parameters, nominal_parameters
from exodrake.machines.robot_file import load_robot, machine_folders
from exodrake.model.robot import drawn_robot

LAWS = {
    "relative": lambda base, x: base * (1.0 + x),
    "additive": lambda base, x: base + x,
    "log": lambda base, x: base * math.exp(x),
    "reciprocal": lambda base, x: 1.0 / (base + x),
}


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
    robot = load_robot(name)
    for effect in robot.machine.effects:
        parameters = effect_parameters(robot, effect)
        assert parameters, effect.id
        for p in parameters:
            low, high = p.bounds
            assert low <= p.start <= high and p.scale > 0.0
            if p.amplitude:
                assert low <= 0.0 <= high
                assert p.value(0.0) == effect.parameters[0].null


def test_healthy_robots_differ_within_tolerance_and_have_no_effect(robot):
    assert [item.role for item in healthy_case(robot, 5).logs] == ["fit", "fit", "fit", "holdout"]
    drawn = np.array([drawn_robot(robot, np.random.default_rng(seed)).values for seed in range(200)])
    parameters = nominal_parameters(robot)
    fitted = sorted(i for p in parameters for i in p.index)
    assert (np.delete(drawn, fitted, axis=1) == np.delete(robot.values, fitted)).all()
    stiffness = next(p for p in parameters if p.name == "finger.kappa.PIP")
    ratio = drawn[:, stiffness.index[0]] / robot.values[stiffness.index[0]] - 1.0
    assert ratio.std() == pytest.approx(stiffness.prior_std, rel=0.2)
    assert np.abs(ratio).max() <= stiffness.bounds[1] + 1e-12


@pytest.fixture(scope="module")
def problem():
    return friction_problem()


def column_of(problem, row, name):
    """One column of a residual."""
    return row.reshape(-1, len(problem.columns))[:, problem.columns.index(name)]


def test_direction_of_a_marker_gain_is_the_angle(problem):
    """q as seen = (1 + gain) q, and nothing else sees the marker: change of the residual = -gain q / noise_std."""
    effect, values = problem.robot.machine.effect("mocap.gain"), problem.silent()
    likelihood = output_error(problem)
    lin = linearise(likelihood, values, [effect], likelihood.residual(values[None])[0])
    first = lin.probes[0]
    pip = next(i for i, p in enumerate(first.parameters) if p.channels == ("PIP",))
    gain = PROBE * first.parameters[pip].start
    direction = lin.directions[first.rows[pip]]
    angle = column_of(problem, problem.predict(values[None], problem.fit[0])[0], "angle_PIP")
    noise_std = problem.noise_std[problem.columns.index("angle_PIP")]
    assert column_of(problem, direction, "angle_PIP") == pytest.approx(-gain * angle / noise_std, abs=1e-3)
    others = direction.reshape(-1, len(problem.columns)).copy()
    others[:, problem.columns.index("angle_PIP")] = 0.0
    assert np.abs(others).max() < 1e-6 * np.abs(direction).max()


def test_a_direction_is_taken_where_its_response_is_as_large_as_the_gap(problem):
    """Of a little slack a direction of the usual size has another shape."""
    machine, values, likelihood = problem.robot.machine, problem.silent(), output_error(problem)
    effect = machine.effect("tendon.slack")
    parameters = effect_parameters(problem.robot, effect)
    x = np.array([0.05 * p.start if p.channels == ("MF",) else 0.0 for p in parameters])
    residual, planted = likelihood.residual(np.array([values, apply(values, parameters, x)]))
    gap = planted - residual

    def compare(**given):
        """Sine of the angle between the direction of the channel and the gap, and the ratio of their lengths."""
        probe = (found := linearise(likelihood, values, [effect], residual, **given)).probes[0]
        ends = [p.bounds[1] for p in parameters if p.amplitude]
        assert probe.coordinates(probe.high)[list(probe.scaled)] == pytest.approx(ends)
        row = found.directions[probe.rows[int(np.flatnonzero(x)[0])]].astype(float)
        length, along = np.linalg.norm(row), row @ gap / np.linalg.norm(gap)
        return np.sqrt(1.0 - (along / length) ** 2), length / np.linalg.norm(gap)

    (angle, length), (usual, longer) = compare(gap=gap), compare()
    assert angle < 0.01 < 0.1 < usual and length == pytest.approx(1.0, abs=0.1) and longer > 10.0


def test_jacobian_holds_in_all_directions_those_that_hardly_show_included(problem):
    """Lengths, spools and stiffness that grow together hardly show; a long step would show their curvature instead."""
    likelihood, values, nominal = output_error(problem), problem.silent(), nominal_parameters(problem.robot)
    prior_std = np.array([p.prior_std for p in nominal])
    (base,) = likelihood.residual(values[None])
    bare = Explanation((), nominal, np.zeros(len(nominal)), values, base, np.zeros((len(nominal), 0)))
    jacobian = nominal_jacobian(likelihood, bare) * prior_std[:, None]
    seen = [k for k, row in enumerate(jacobian) if row @ row > 0.0]
    sizes, directions = np.linalg.eigh(jacobian[seen] @ jacobian[seen].T)
    assert sizes[-1] > 1e6 * sizes[0]
    for direction in directions.T[::4]:
        move = np.zeros(len(nominal))
        move[seen] = 0.05 * direction
        ends = [apply(values, nominal, sign * move * prior_std) for sign in (1.0, -1.0)]
        forth, back = likelihood.residual(np.array(ends))
        central = (forth - back) / 2.0
        assert np.linalg.norm(move @ jacobian - central) < 0.05 * np.linalg.norm(central)


def test_every_direction_belongs_to_one_probe_and_simulated_time_is_counted(problem):
    likelihood, effects = output_error(problem, "here"), problem.robot.machine.effects[:6]
    values = problem.silent()
    lin = linearise(likelihood, values, effects, likelihood.residual(values[None])[0])
    rows = np.concatenate([probe.rows for probe in lin.probes])
    np.testing.assert_array_equal(rows, np.arange(len(lin.directions)))
    assert {probe.effect for probe in lin.probes} == {effect.id for effect in effects}
    simulated = 1 + len(lin.directions)  # robots, 6 s each
    assert likelihood.simulated["here"] == pytest.approx(simulated * 300 * problem.robot.machine.frame)


def test_probes_stay_within_the_bounds_of_a_fit(problem):
    for effect in problem.robot.machine.effects:
        tried = probes(problem, effect, 0)
        assert tried or effect.not_tried
        for probe in tried:
            low, high = np.array([p.bounds for p in probe.parameters]).T
            assert (probe.x >= low - 1e-12).all() and (probe.x <= high + 1e-12).all()
            assert (probe.low <= probe.high).all()
            for factors in (probe.low, probe.high):
                x = probe.coordinates(factors)
                assert (x >= low - 1e-9).all() and (x <= high + 1e-9).all()


@pytest.mark.parametrize(
    ("machine", "effect", "shapes"),
    [
        ("exo_index", "motor.slow_velocity_loop", 2),
        ("tendon_sheath", "sheath.capstan_play", 2),
        ("so101", "servo.lag", 0),
    ],
)
def test_shapes_of_a_law_are_tried_at_two_places_on_any_machine(machine, effect, shapes):
    robot = load_robot(machine)
    parameters = effect_parameters(robot, robot.machine.effect(effect))
    amplitudes = tuple(i for i, p in enumerate(parameters) if p.amplitude)
    points = scaled_points(parameters, np.array([p.start for p in parameters]), amplitudes)
    moved = {i for x in points[1:] for i in np.flatnonzero(x != points[0])}
    assert len(points) == 1 + shapes and not moved & set(amplitudes)
