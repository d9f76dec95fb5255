"""Retune: the nominal parameters alone, fitted in closed loop."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np

from exodrake.diagnosis.likelihood import output_error
from exodrake.diagnosis.linearise import linearise
from exodrake.diagnosis.parameter import nominal_parameters
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.refine import Explanation, minimise

RETUNE_ROUNDS = 3  # linearisations
STEPS, TOL = 4, 1e-3  # of the fit after each


def retune(problem: Problem) -> tuple[Explanation, defaultdict[str, float]]:
    """The nominal parameters fitted in closed loop in units of the sensors' noise, and the simulated time."""
    nominal, likelihood, values = nominal_parameters(problem.robot), output_error(problem, "retune"), problem.silent()
    found = Explanation((), nominal, np.zeros(len(nominal)), values, np.zeros(0), np.zeros((0, 0)))
    for _ in range(RETUNE_ROUNDS):
        lin = linearise(likelihood, values, found.x, nominal, ())
        likelihood = likelihood.scaled_to(lin.residual)
        found = minimise(likelihood, replace(found, residual=lin.residual, jacobian=lin.jacobian), STEPS, TOL)
    return found, likelihood.simulated
