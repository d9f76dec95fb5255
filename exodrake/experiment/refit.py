"""Nonlinear refits of rivals to a motion, carried to convergence where a linear refit is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from exodrake.diagnosis.parameter import apply
from exodrake.experiment.contest import Contest
from exodrake.experiment.information import Information, information_of
from exodrake.experiment.terms import Terms, derivatives, terms_of

STEPS = 2  # of Gauss and Newton after the linear refit: assumed
SHARES = 1.0, 0.5, 0.25, 0.1  # of a step that are tried


def refitted(contest: Contest, reference: np.ndarray) -> Information | None:
    """Expected information of a reference (frames, references) [SI] with rivals refitted to the end; or None."""
    terms = terms_of(contest, reference)
    found = information_of(contest, terms) if terms else None
    if terms is None or found is None:
        return None
    return replace(found, ended={key: ended(contest, terms, found, *key) for key in found.pairs})


def ended(contest: Contest, terms: Terms, found: Information, true: int, rival: int) -> tuple[float, np.ndarray]:
    """T of a refit, no more than that of the linear one, and its changes (parameters,) in units of `spreads`."""
    e, spread, weights = contest.explanations[rival], contest.spreads[rival], terms.weights(true, rival)
    pair, z, cost = found.pairs[true, rival], np.zeros(contest.spreads[rival].shape[1]), found.pairs[true, rival].square
    row, step = terms.rows[rival], found.pairs[true, rival].refit
    for k in range(1 + STEPS):
        if k:
            columns = derivatives(terms.likelihood, replace(e, x=coordinates(contest, rival, z)), spread, row)
            weighted = columns * weights
            slope = weighted @ (row - terms.rows[true]) + z
            step = -np.linalg.solve(np.eye(len(z)) + weighted @ columns.T, slope)
        tried = [z + share * step for share in SHARES]
        robots = np.array([apply(e.values, e.parameters, coordinates(contest, rival, one)) for one in tried])
        rows = terms.likelihood.residual(robots)
        costs = [float(weights @ (r - terms.rows[true]) ** 2 + one @ one) for r, one in zip(rows, tried, strict=True)]
        best = int(np.argmin(costs))
        if costs[best] >= cost:
            break
        z, row, cost = tried[best], rows[best], costs[best]
    return (cost, z) if cost < pair.left else (pair.left, pair.refit)


def coordinates(contest: Contest, rival: int, z: np.ndarray) -> np.ndarray:
    """Coordinates (parameters,) of a rival that moved by z (directions,)."""
    e = contest.explanations[rival]
    return np.clip(e.x + contest.spreads[rival] @ z, *e.bounds)
