"""Retuning: fit of the nominal parameters alone to the prediction errors, or in closed loop where there are none.

A loop that hunts or a finger that snaps over gives the closed-loop cost many minima. Feedback of the measured outputs
leaves few (prediction error method: Ljung 1999; multiple shooting: Bock 1983). The isolation fits both views.
"""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from exodrake.diagnosis.likelihood import output_error, with_prediction
from exodrake.diagnosis.linearise import nominal_jacobian
from exodrake.diagnosis.parameter import nominal_parameters
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.refine import Explanation, minimise

RETUNE_ROUNDS = 3  # nominal Jacobians at most; the isolation begins with one more
LEAST_GAIN = 0.1  # mean logarithm of chi-squares that is left and that one must gain for the next one: assumed
STEPS, TOL = 4, 1e-3  # of the fit after each


def retune(problem: Problem, known: Explanation | None = None) -> tuple[Explanation, defaultdict[str, float]]:
    """The nominal parameters fitted in units of the sensors' noise, and the simulated time.

    known: the same before something was detected, where the fit begins; the nominal robot if None.
    """
    nominal, values = nominal_parameters(problem.robot), problem.silent()
    likelihood = output_error(with_prediction(problem)[-1], "retune")
    x = np.zeros(len(nominal)) if known is None else known.x
    found = Explanation((), nominal, x, values, np.zeros(0), np.zeros((0, 0))).at(likelihood, x)
    for _ in range(RETUNE_ROUNDS):
        before, likelihood = likelihood.mean_log(found.residual), likelihood.scaled_to(found.residual)
        jacobian = nominal_jacobian(likelihood, values, nominal, found.x, found.residual)
        found = minimise(likelihood, found.with_jacobian(jacobian), STEPS, TOL)
        left = likelihood.mean_log(found.residual)
        if min(left, before - left) < LEAST_GAIN:
            break
    return found, likelihood.simulated
