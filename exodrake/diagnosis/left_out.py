"""Leave-one-out robots: the fitted robot as it would be without some logs, for a closure on logs that were not fitted.

    x_k = x - (J'J + P)^-1 (J'r + P x)

J, r: Jacobian and residual without the rows of the logs k, at the fit x to all logs. P: prior precision. This is one
Gauss-Newton step from the joint fit. It is small where those logs do not decide.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.parameter import apply
from exodrake.diagnosis.projection import normal_matrix
from exodrake.diagnosis.refine import Explanation, whole_jacobian


def without_logs(likelihood: Likelihood, e: Explanation, groups: Sequence[Collection[int]]) -> np.ndarray:
    """Flat parameter vectors (groups, parameters) [SI] of an explanation fitted to all logs but those of one group."""
    likelihood, precision = likelihood.scaled_to(e.residual), 1.0 / e.prior_std**2
    columns, found = whole_jacobian(likelihood, e), []
    for logs in groups:
        weights = np.where(likelihood.samples_of(logs), 0.0, likelihood.weights)
        jacobian, residual = columns * weights, e.residual * weights
        move = np.linalg.solve(normal_matrix(jacobian, precision), jacobian @ residual + precision * e.x)
        found.append(apply(e.values, e.parameters, np.clip(e.x - move, *e.bounds)))
    return np.array(found)


def without_each_log(likelihood: Likelihood, e: Explanation) -> np.ndarray:
    """Flat parameter vectors (logs, parameters) [SI] of an explanation fitted to all logs but one."""
    return without_logs(likelihood, e, [[log] for log in range(len(likelihood.views[0].problem.fit))])
