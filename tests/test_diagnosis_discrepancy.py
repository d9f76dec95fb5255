"""Model discrepancy: random functions of the measured state of zero mean and unit variance."""

import numpy as np
import pytest
from diagnosis_cases import friction_problem
from formula_case import FRAME, explanation, likelihood_of, linearisation, nominal
from scipy import stats

from exodrake.diagnosis.calibration import UNCALIBRATED, calibration_of
from exodrake.diagnosis.discrepancy import TYPICAL, LawErrors, random_functions
from exodrake.diagnosis.likelihood import output_error
from exodrake.diagnosis.parameter import effect_parameters
from exodrake.diagnosis.projection import Projection
from exodrake.diagnosis.refine import Explanation


def functions(measured, draws=50):
    likelihood = likelihood_of(lambda row: row, measured=measured, columns=measured[0].shape[1])
    return random_functions(likelihood, draws, 1)


def test_functions_have_zero_mean_and_unit_variance_over_all_logs():
    time = FRAME * np.arange(700)
    logs = [np.column_stack([np.sin(rate * time), np.cos(1.7 * rate * time)]) for rate in (1.0, 2.0)]
    h = functions(logs)
    assert h.shape == (50, 2 * 2 * 700)
    assert h.mean(axis=1) == pytest.approx(np.zeros(50), abs=1e-4) and h.std(axis=1) == pytest.approx(1.0, abs=1e-3)


def test_functions_are_alike_in_all_columns_and_equal_in_equal_states():
    period = np.sin(2 * np.pi * np.arange(100) / 100)
    h = functions([np.tile(period, 4)[:, None] * (1.0, 0.5)]).reshape(50, 400, 2)
    np.testing.assert_array_equal(h[..., 0], h[..., 1])
    np.testing.assert_allclose(h[:, 120:180, 0], h[:, 220:280, 0], atol=1e-4)


def test_robot_at_rest_has_no_discrepancy():
    """A function of columns that stand still is constant: it has no variance that could be scaled to one."""
    time = FRAME * np.arange(300)
    half_still = np.column_stack([np.sin(time), np.ones(300), np.zeros(300)])
    for measured in (np.zeros((300, 2)), half_still):
        h = functions([measured], 200)
        assert np.isfinite(h).all() and np.abs(h).max() < 20.0
    assert np.abs(functions([np.zeros((300, 2))])).max() < 1e-3


def test_difference_between_simulators_is_normal_with_the_error_of_a_same_meaning_law_as_its_upper_quantile():
    """Without effects both are the change by retuning times one function, so that their ratio is the drawn size."""
    time = FRAME * np.arange(60)
    likelihood = likelihood_of(lambda row: row[:1] * np.sin(time), measured=[np.sin(time)[:, None]])
    e = explanation(likelihood, nominal(1, 1.0), np.zeros(1), np.sin(time)[None])
    law, model = LawErrors(likelihood, np.ones(60), 2000, UNCALIBRATED)(Projection(likelihood, e, linearisation(e)))
    size = np.einsum("ij,ij->i", model, law) / np.einsum("ij,ij->i", law, law)
    np.testing.assert_allclose(model, size[:, None] * law, atol=1e-6)
    assert stats.kstest(size, stats.norm(0.0, TYPICAL).cdf).pvalue > 0.01
    assert np.mean(np.abs(size) < 1.0) == pytest.approx(0.95, abs=0.02)


def contributions_of(effect):
    """An explanation with an effect alone, its likelihood, and the contributions of its law's errors."""
    problem = friction_problem()
    machine, likelihood = problem.robot.machine, output_error(problem)
    parameters = effect_parameters(machine, machine.effect(effect))
    x = np.array([p.start if p.amplitude else p.bounds[1] for p in parameters])
    start = Explanation((effect,), parameters, x, problem.silent(), np.zeros(0), np.zeros((0, likelihood.samples)))
    e, limits = start.at(likelihood, x), calibration_of(machine)
    laws = LawErrors(likelihood, np.zeros(likelihood.samples), 2, limits)
    return e, likelihood, limits, laws.contributions(Projection(likelihood, e, linearisation(e)))


def test_what_shapes_a_law_is_as_wrong_as_any_law_where_its_amplitude_means_the_same_in_all():
    """The length of a slack wire is a length in every law; how it comes taut differs from law to law."""
    e, likelihood, limits, (_, *amplitudes, (toe, rho)) = contributions_of("tendon.slack")
    assert [size for _, size in amplitudes] == [limits.same_meaning] * 3 and rho == limits.law_error
    sharp = e.robot
    for i in likelihood.robot.machine.effect_indices("tendon.slack", "toe").values():
        sharp[i] = 1e-4  # m, its null value
    np.testing.assert_allclose(toe, likelihood.residual(sharp[None])[0] - e.residual, atol=1e-9)
    assert np.abs(toe).max() > 1.0


def test_law_of_one_meaning_without_a_shape_is_as_wrong_as_two_simulators():
    _, _, limits, (_, *rows) = contributions_of("encoder.homing_offset")
    assert [size for _, size in rows] == [limits.same_meaning] * 3
