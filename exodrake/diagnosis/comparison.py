"""Comparison of two explanations: what one leaves less, whether it is a richer law, how far it leans on tolerances."""

from __future__ import annotations

import numpy as np

from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.refine import Explanation


def power(rows: np.ndarray) -> np.ndarray:
    """Sum of squares of rows (..., samples)."""
    return np.einsum("...i,...i->...", rows, rows, dtype=float)


def taken_up(likelihood: Likelihood, e: Explanation, rival: Explanation) -> tuple[float, float]:
    """What a rival leaves less than an explanation: weighted sum of squares, and share of the excess over noise."""
    own, other = ((likelihood.chi2(x.residual), x.residual * likelihood.weights) for x in (e, rival))
    weights = 1.0 / np.maximum(own[0], 1e-12)
    excess = float(np.sum(weights * np.maximum(own[0] - 1.0, 0.0)))
    less = float(np.sum(weights * (np.maximum(own[0], 1.0) - np.maximum(other[0], 1.0))))
    return float(power(own[1]) - power(other[1])), less / excess if excess > 0.0 else 0.0


def richer_law(likelihood: Likelihood, richer: Explanation, simpler: Explanation) -> bool:
    """Whether an explanation holds another law of the same effects, with more parameters."""
    machine = likelihood.robot.machine
    kinds = [sorted((machine.effect(i).block, machine.effect(i).family) for i in e.effects) for e in (richer, simpler)]
    return kinds[0] == kinds[1] and len(richer.x) > len(simpler.x)


def tolerance_use(e: Explanation) -> float:
    """Mean square change of the nominal parameters in standard deviations of their tolerances [-]."""
    return float(np.mean((e.x / e.prior_std)[: e.nominal] ** 2)) if e.nominal else 0.0
