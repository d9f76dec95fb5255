"""Leave one log out: for a linear model the formula is the fit to the other logs."""

import numpy as np
import pytest
from formula_case import explanation, likelihood_of, nominal

from exodrake.diagnosis.left_out import without_each_log

FRAMES = (120, 80, 200)
PRIOR = 0.5


def test_robot_without_a_log_is_that_fitted_to_the_others():
    rng = np.random.default_rng(3)
    jacobian, offset = rng.standard_normal((4, sum(FRAMES))), rng.standard_normal(sum(FRAMES))
    likelihood = likelihood_of(lambda row: offset + row[:4] @ jacobian, FRAMES)
    fit = -np.linalg.solve(jacobian @ jacobian.T + np.eye(4) / PRIOR**2, jacobian @ offset)
    e = explanation(likelihood, nominal(4, PRIOR), fit, jacobian)
    weight = likelihood.scaled_to(e.residual).weights[0] ** 2
    found = without_each_log(likelihood, e)
    starts = np.cumsum((0, *FRAMES))
    for k, robot in enumerate(found):
        kept = np.ones(sum(FRAMES), dtype=bool)
        kept[starts[k] : starts[k + 1]] = False
        assert (likelihood.samples_of([k]) == ~kept).all()
        normal = weight * jacobian[:, kept] @ jacobian[:, kept].T + np.eye(4) / PRIOR**2
        assert robot[:4] == pytest.approx(-np.linalg.solve(normal, weight * jacobian[:, kept] @ offset[kept]), abs=1e-6)
