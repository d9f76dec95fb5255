"""Screening session by session: one session is the ordinary linearisation, against least squares of scipy."""

import numpy as np
import pytest
from formula_case import likelihood_of
from scipy.linalg import lstsq

from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.linearise import Linearisation, Probe
from exodrake.diagnosis.parameter import Parameter
from exodrake.diagnosis.projection import Projection
from exodrake.diagnosis.refine import Explanation
from exodrake.diagnosis.session_screen import Split
from exodrake.diagnosis.sessions import Session


def test_one_session_takes_up_what_least_squares_says_in_two_views_of_different_scale():
    rng = np.random.default_rng(0)
    views = [
        likelihood_of(lambda row: row, (400,), columns, scale=scale).views[0]
        for columns, scale in ((3, 6.0), (2, 30.0))
    ]
    likelihood = Likelihood(tuple(views))
    nominal = tuple(Parameter(f"p{i}", (i,), "additive", 0.0, 1.0, (-9.0, 9.0)) for i in range(4))
    jacobian, directions = (rng.standard_normal((n, likelihood.samples)).astype(np.float32) for n in (4, 2))
    residual = 0.1 * rng.standard_normal(likelihood.samples) - np.array([1.5, -0.7]) @ directions
    e = Explanation((), nominal, np.zeros(4), np.zeros(4), residual, jacobian)
    probe = Probe("a.b", (), np.zeros(2), (0, 1), np.arange(2), np.full(2, -9.0), np.full(2, 9.0))
    lin = Linearisation(nominal, np.zeros(4), residual, jacobian, directions, (probe,))
    gain, factors = Split(Projection(likelihood, e, lin), [Session("all", 0.0, (0,))])(probe)
    w = likelihood.weights
    columns = np.vstack([np.hstack([(jacobian * w).T, (directions * w).T]), np.hstack([np.eye(4), np.zeros((4, 2))])])
    wanted = np.r_[-residual * w, np.zeros(4)]
    solved = lstsq(columns, wanted)[0]
    without = lstsq(columns[:, :4], wanted)[0]
    left = [np.sum((columns[:, : len(x)] @ x - wanted) ** 2) for x in (without, solved)]
    assert factors[0] == pytest.approx(solved[4:], rel=1e-4) and gain == pytest.approx(left[0] - left[1], rel=1e-3)
