"""The fit: bounded least squares and Levenberg-Marquardt, against scipy and injected parameters."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from diagnosis_cases import INJECTED, friction_problem
from formula_case import amplitude, explanation, likelihood_of, nominal
from scipy.optimize import least_squares, lsq_linear

from benchmarks import diagnosis as bench
from exodrake.diagnosis.fit import Explanation, minimise
from exodrake.diagnosis.likelihood import output_error
from exodrake.diagnosis.linear import minimise_bounded
from exodrake.diagnosis.linearise import nominal_jacobian
from exodrake.diagnosis.parameter import apply, effect_parameters, nominal_parameters
from exodrake.diagnosis.problem import make_problem
from exodrake.machines.robot_file import load_robot


def test_bounded_minimum_is_that_of_scipy():
    rng = np.random.default_rng(0)
    for _ in range(20):
        matrix, target = rng.standard_normal((30, 8)) * np.logspace(-2, 2, 8), 5.0 * rng.standard_normal(30)
        size = np.linalg.norm(matrix, axis=0)
        low, high = -rng.random(8) / size, rng.random(8) / size
        wanted = lsq_linear(matrix, target, (low, high), method="bvls", tol=1e-14)
        found, value = minimise_bounded(matrix.T @ matrix, -matrix.T @ target, low, high)
        assert found * size == pytest.approx(wanted.x * size, abs=1e-6)
        assert value == pytest.approx(wanted.cost - 0.5 * target @ target, rel=1e-6)


def test_corrected_jacobian_ends_at_scipys_minimum():
    """Nominal parameters act nonlinearly, so that the Jacobian of the start, taken 1 away, is wrong at the end."""
    rng = np.random.default_rng(2)
    matrix, other, truth = rng.standard_normal((3, 400)), rng.standard_normal(400), np.array([0.5, -0.4, 0.3, 0.7])
    noise = 0.1 * rng.standard_normal(400)

    def formula(row):
        return np.tanh(row[:3] - truth[:3]) @ matrix + (np.exp(row[3]) - np.exp(truth[3])) * other + noise

    likelihood, parameters = likelihood_of(formula), (*nominal(3, 1.0), amplitude("a", 3))
    step = 1e-6 * np.eye(4)[:3]
    start = np.array([-0.5, 0.6, -0.7, 1.5])
    jacobian = np.array([(formula(start + row) - formula(start)) / 1e-6 for row in step])
    found = minimise(likelihood, explanation(likelihood, parameters, start, jacobian, ("a",)), 60, 1e-12)
    wanted = least_squares(lambda x: np.concatenate([formula(x), x[:3]]), start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert found.x == pytest.approx(wanted.x, abs=2e-3)
    assert found.cost(likelihood) == pytest.approx(wanted.cost, rel=1e-4)


def test_fit_stays_within_bounds():
    likelihood = likelihood_of(lambda row: np.full(400, row[0] - 2.0))
    parameter = replace(amplitude("a", 0), bounds=(0.0, 1.0))
    start = explanation(likelihood, (parameter,), np.array([0.5]), np.zeros((0, 400)), ("a",))
    assert minimise(likelihood, start, 20, 1e-9).x == pytest.approx([1.0])


def test_a_limit_that_is_not_reached_does_not_stop_a_fit():
    """A bowed amplitude of 2 beside one that hardly acts below 0.5, and beyond spoils everything.

    Damping by the curvature lets the second one leap to its bound, four times in a row.
    """
    rng = np.random.default_rng(8)
    matrix = rng.standard_normal((2, 400))
    noise = 0.1 * (rng.standard_normal(400) - matrix[1])

    def formula(row):
        idle, spoilt = 1e-7 * row[1], 1e3 * max(row[1] - 0.5, 0.0)
        return (row[0] + 0.1 * row[0] ** 2 - 2.4) * matrix[0] + (idle + spoilt) * matrix[1] + noise

    likelihood, parameters = likelihood_of(formula), (amplitude("a", 0), amplitude("b", 1, (0.0, 8.0)))
    start = explanation(likelihood, parameters, np.zeros(2), np.zeros((0, 400)), ("a", "b"))
    found = minimise(likelihood, start, 10, 1e-6)
    assert found.x[0] == pytest.approx(2.0, abs=0.02) and found.x[1] < 0.51


def test_injected_parameters_of_a_simulated_robot_are_recovered_as_by_scipy():
    """Friction of three tendons and six nominal parameters on 6 s of motion."""
    problem = friction_problem()
    machine, likelihood, values = problem.robot.machine, output_error(problem), problem.silent()
    nominals = nominal_parameters(problem.robot)[:6]
    parameters = (*nominals, *effect_parameters(problem.robot, machine.effect("tendon.capstan_friction")))
    x = np.array([p.start for p in parameters])
    (residual,) = likelihood.residual(values[None])
    start = Explanation((), nominals, np.zeros(6), values, residual, np.zeros((6, 0)))
    jacobian = nominal_jacobian(likelihood, start)
    start = Explanation(("tendon.capstan_friction",), parameters, x, values, residual, jacobian)
    found = minimise(likelihood, start.at(likelihood, x), 30, 1e-7)
    coefficients = [p.value(c) for p, c in zip(parameters[6:], found.x[6:], strict=True)]
    assert coefficients == pytest.approx([INJECTED[p.channels[0]] for p in parameters[6:]], abs=0.01)

    def rows(x):
        return np.concatenate([likelihood.residual(apply(values, parameters, x)[None])[0], x / start.prior_std])

    scale = np.array([p.scale for p in parameters])
    wanted = least_squares(rows, x, x_scale=scale, bounds=np.array([p.bounds for p in parameters]).T, diff_step=1e-3)
    assert found.cost(likelihood) < wanted.cost + 0.5 * 0.6**2 * len(x)  # 0.6 standard deviations of each parameter
    assert (found.x - wanted.x) / scale == pytest.approx(np.zeros(len(x)), abs=0.1)


@pytest.mark.parametrize("imitated", [0.0, -0.07, 1e-9])
def test_minimiser_survives_a_direction_that_others_imitate_but_for_rounding(imitated):
    """Schur complements in single precision leave such a diagonal; the other direction keeps its closed form."""
    normal = np.array([[4e5, 0.2], [0.2, imitated]])
    found, _ = minimise_bounded(normal, np.array([-2e5, 1e-5]), np.array([-1.0, -1.0]), np.array([1.0, 1.0]))
    assert found[0] == pytest.approx(0.5, abs=1e-3) and np.isfinite(found).all() and np.abs(found[1]) <= 1.0


def test_a_parameter_without_play_stays_where_it_is_however_steep_the_cost():
    """Of a simulation that diverges the curvature is that of a residual of 10^7 noise standard deviations."""
    found, value = minimise_bounded(np.array([[5e14]]), np.array([2e6]), np.array([1.0]), np.array([1.0]))
    assert found == pytest.approx([1.0], rel=1e-6) and value == pytest.approx(2.5e14, rel=1e-6)


@pytest.mark.filterwarnings("error")
def test_a_parameter_without_bounds_stays_without_them_where_another_ends_at_its_own():
    """The minimum over b of (a - 1)^2 + (b - 3)^2 + a b where a is at least 0: a = 0, b = 3."""
    normal, slope = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-2.0, -6.0])
    found, value = minimise_bounded(normal, slope, np.array([0.0, -np.inf]), np.array([1.0, np.inf]))
    assert found == pytest.approx([0.0, 3.0], abs=1e-9) and value == pytest.approx(-9.0)


@pytest.fixture(scope="module")
def problem():
    nominal = load_robot()
    return make_problem(bench.rubbing(nominal, 4.0), nominal)


@pytest.fixture(scope="module")
def parameters(problem):
    return bench.injected_parameters(problem.robot)


def test_diagram_and_compiled_simulator_leave_the_same_residual(problem, parameters):
    start = np.array([p.start for p in parameters])
    np.testing.assert_array_equal(
        *(f(problem, parameters, start) for f in (bench.compiled_residual, bench.diagram_residual))
    )


def test_own_fit_and_scipy_find_what_was_injected(problem, parameters):
    truth = [bench.INJECTED[p.channels[0]] for p in parameters]
    residual = partial(bench.compiled_residual, problem, parameters)
    for x in (bench.ours(problem), bench.by_scipy(residual, parameters)):
        np.testing.assert_allclose([p.value(c) for p, c in zip(parameters, x)], truth, rtol=0.1)


def test_scaling_cuts_logs_and_reads_exponents():
    from benchmarks.scaling import cut, growth

    case = bench.rubbing(load_robot(), 4.0)
    short = cut(case, 1.0)
    assert [len(item.log.time) for item in short.logs] == [51, 51]  # both ends of 1 s at 20 ms
    np.testing.assert_array_equal(short.logs[0].log["tension_AF"], case.logs[0].log["tension_AF"][:51])
    assert growth([1.0, 2.0, 4.0], [3.0, 12.0, 48.0]) == pytest.approx(2.0)
