"""Use of the tolerances: ridge regression in closed form and by numpy, and robots with another law than their model."""

import numpy as np
import pytest
from formula_case import amplitude, explanation, likelihood_of, linearisation, nominal

from exodrake.diagnosis.calibration import UNCALIBRATED, spread
from exodrake.diagnosis.p_values import ViewNull
from exodrake.diagnosis.projection import Projection
from exodrake.diagnosis.tolerances import HALVINGS, STRONGEST, least_use, most_use, tolerance_use

FRAMES, NOMINAL, PRIOR = 400, 3, 0.5


def project_of(jacobian, left, x, bounds=(-1e6, 1e6)):
    """The projection of an explanation with one effect, whose residual is `left` at nominal coordinates x."""
    count, direction = len(jacobian), np.random.default_rng(8).standard_normal(FRAMES)

    def residual(row):
        return left + (row[:count] - x) @ jacobian + row[count] * direction

    likelihood = likelihood_of(residual)
    parameters = (*nominal(count, PRIOR, bounds), amplitude("effect", count))
    e = explanation(likelihood, parameters, np.r_[x, 0.0], jacobian, ("effect",))
    return Projection(likelihood, e, linearisation(e))


def random_project(seed=0, **kinds):
    rng = np.random.default_rng(seed)
    jacobian, left = rng.standard_normal((NOMINAL, FRAMES)), rng.standard_normal(FRAMES)
    return project_of(jacobian, left, 2.0 * PRIOR * rng.standard_normal(NOMINAL), **kinds)


@pytest.mark.parametrize("factor", [1.0, 30.0, 1e3])
def test_held_fit_is_numpys_least_squares_with_the_priors_as_samples(factor):
    project = random_project()
    e, weights = project.explanation, project.weights
    precision = 1.0 / e.prior_std * np.r_[np.full(NOMINAL, np.sqrt(factor)), 1.0]
    rows = np.concatenate([(project.columns * weights).T, np.diag(precision)])
    expected = np.linalg.lstsq(rows, -np.r_[e.residual * weights, precision * e.x])[0]
    np.testing.assert_allclose(project.held(factor), expected, rtol=1e-4, atol=1e-6)


def test_held_fit_keeps_within_the_bounds():
    project = random_project(bounds=(-0.1, 0.1))
    low, high = project.explanation.bounds
    x = project.explanation.x + project.held(1.0)
    assert np.all((x >= low - 1e-12) & (x <= high + 1e-12))


def test_least_use_is_where_the_residual_comes_to_its_limit():
    """One parameter at x with slope j leaves c + (x - x0)^2 j'j: at a limit of c + d it is at x0 - sqrt(d / j'j)."""
    rng = np.random.default_rng(1)
    j, x0 = rng.standard_normal((1, FRAMES)), 2.0
    left = rng.standard_normal(FRAMES)
    left -= j[0] * (left @ j[0]) / (j[0] @ j[0])
    project, rise = project_of(j, left, np.array([x0])), 300.0
    limit = left @ left + rise
    found = least_use(project, lambda residual: residual @ residual <= limit)
    step = np.log(STRONGEST) / 2**HALVINGS  # of the logarithm of the factor, which changes x by less
    expected = (x0 - np.sqrt(rise / (j[0] @ j[0]))) ** 2 / PRIOR**2
    assert found == pytest.approx(expected, rel=4.0 * step + 0.02)  # the effect's amplitude takes up a little, too
    assert found >= expected * 0.97


def test_least_use_is_that_of_the_fit_if_the_logs_reject_it_or_it_has_no_effect():
    project = random_project()
    assert least_use(project, lambda residual: False) == tolerance_use(project.explanation)
    likelihood = likelihood_of(lambda row: row[0] * np.ones(FRAMES))
    alone = explanation(likelihood, nominal(1, PRIOR), np.ones(1), np.ones((1, FRAMES)))
    free = Projection(likelihood, alone, linearisation(alone))
    assert least_use(free, lambda residual: True) == tolerance_use(alone) == pytest.approx(1.0 / PRIOR**2)


def imitated(seed, error):
    """Use and least use of a robot whose law errs by a row that its nominal parameters imitate, half of it theirs."""
    rng = np.random.default_rng(seed)
    jacobian, own = rng.standard_normal((NOMINAL, FRAMES)), rng.standard_normal(FRAMES)
    shape = own + jacobian.sum(axis=0) / np.sqrt(NOMINAL)
    true, noise = PRIOR * rng.standard_normal(NOMINAL), rng.standard_normal(FRAMES)
    measured = noise - true @ jacobian + error * shape
    x = -np.linalg.lstsq(jacobian.T, measured)[0]
    project = project_of(jacobian, measured + x @ jacobian, x)
    draws = np.random.default_rng(2).standard_normal((99, FRAMES)), 3.0 * rng.standard_normal((99, 1)) * shape
    null = ViewNull.of(project.likelihood, *draws)
    return tolerance_use(project.explanation), least_use(project, lambda residual: min(null.p_values(residual)) > 0.02)


def test_error_of_a_law_needs_no_tolerances_and_other_robots_keep_theirs():
    """Errors of the law as large as its standard deviation allows: fits move beyond, the robots that count do not."""
    most = max(UNCALIBRATED.moved, spread(NOMINAL))
    found = np.array([imitated(seed, 3.0) for seed in range(40)])
    assert np.mean(found[:, 0] > most) > 0.5
    assert np.mean(found[:, 1] > most) < 0.1
    assert np.all(found[:, 1] <= found[:, 0])


def test_most_use_of_an_explanation_with_effects_is_chi_squares_quantile():
    project = random_project()
    assert most_use(project, UNCALIBRATED, np.zeros((1, FRAMES))) == max(UNCALIBRATED.moved, spread(NOMINAL))
