"""Fits in a local minimum: repeated from another law of the same effects, or by a pattern search.

A threshold is crossed in one frame or in the next, so the residual of a dead zone jumps with its width, and derivatives
over small steps do not describe larger ones. The pattern search simulates steps to both sides of each parameter at
once. It halves the steps where none lowers the cost by `TOL` (Hooke & Jeeves 1961).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from exodrake.diagnosis.comparison import other_law
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.refine import STEPS, TOL, Explanation, minimise

FIRST, LEAST = 0.16, 0.01  # steps: shares of an amplitude, or of the range of a further parameter; assumed


def from_another_law(
    likelihood: Likelihood, e: Explanation, found: Sequence[Explanation], behind: float
) -> Explanation:
    """An explanation fitted again from another law of the same effects, if that leaves less than it does.

    Parameters of the effects keep the values of those that are called alike, and others begin anew.

    Args:
        likelihood: views of the case.
        e: the explanation.
        found: fitted explanations.
        behind: mean logarithm of chi-squares by which e is so far behind that its law is wrong, unless it has more
            parameters, as a law has that holds another one.
    """
    left = likelihood.mean_log(e.residual)
    better = [s for s in found if likelihood.mean_log(s.residual) < left and other_law(likelihood, e, s)]
    better = [s for s in better if len(e.x) > len(s.x) or left - likelihood.mean_log(s.residual) < behind]
    if not better:
        return e
    best, count = min(better, key=lambda s: s.cost(likelihood)), e.nominal
    likelihood = likelihood.scaled_to(best.residual)
    known = {(p.name.split(".")[-1], p.channels): p.value(x) for p, x in zip(best.parameters, best.x) if p.effect}
    own, low, high = e.parameters[count:], *e.bounds[:, count:]
    starts = []
    for others in (np.array([p.start for p in own]), e.x[count:], low, high):
        alike = [known.get((p.name.split(".")[-1], p.channels)) for p in own]
        x = [o if value is None else p.coordinate(value) for p, o, value in zip(own, others, alike, strict=True)]
        starts.append(np.r_[best.x[:count], np.clip(x, low, high)])
    first = min(e.at_each(likelihood, starts), key=lambda s: s.cost(likelihood)).with_jacobian(best.jacobian)
    return min(e, minimise(likelihood, first, STEPS, TOL), key=lambda s: s.cost(likelihood))


def searched(likelihood: Likelihood, e: Explanation) -> Explanation:
    """The explanation after a search of the parameters of its effects, its nominal parameters as they are."""
    step, found = FIRST, e
    while step > LEAST:
        best = min(found.at_each(likelihood, neighbours(found, step)), key=lambda t: t.cost(likelihood))
        if best.cost(likelihood) < (1.0 - TOL) * found.cost(likelihood):
            found = best
        else:
            step /= 2.0
    return found


def neighbours(e: Explanation, step: float) -> list[np.ndarray]:
    """Coordinates (parameters,) with one parameter of an effect changed by a step, or all amplitudes alike."""
    low, high = e.bounds
    sizes = np.array([step * (abs(x) if p.amplitude else b - a) for p, x, a, b in zip(e.parameters, e.x, low, high)])
    moves = [np.where(np.arange(len(e.x)) == i, sizes, 0.0) for i in range(e.nominal, len(e.x)) if sizes[i]]
    moves.append(np.array([s * np.sign(x) * p.amplitude for p, x, s in zip(e.parameters, e.x, sizes)]))
    return [np.clip(e.x + sign * move, low, high) for move in moves for sign in (1.0, -1.0)]
