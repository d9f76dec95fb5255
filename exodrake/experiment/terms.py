"""Runs of explanations on a motion: differences, derivatives, and errors of the linearisation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.parameter import STEP, apply
from exodrake.diagnosis.problem import Trial
from exodrake.diagnosis.refine import Explanation
from exodrake.experiment.contest import Contest, effective

DRAWS = 8  # plausible robots of an explanation: assumed


@dataclass(frozen=True, eq=False)
class Terms:
    """Terms of the information of a motion: residuals, derivatives and errors of the linearisation.

    Attributes:
        likelihood: of the log that the first explanation would leave.
        rows: (explanations, samples) residuals.
        columns: (directions, samples) derivatives of each.
        missed: (draws, samples) squares of what drawn robots of each miss the linearisation by.
    """

    likelihood: Likelihood
    rows: np.ndarray
    columns: list[np.ndarray]
    missed: list[np.ndarray]

    def weights(self, true: int, rival: int) -> np.ndarray:
        """W (samples,)."""
        frames = effective(self.likelihood)
        missed = np.mean(self.missed[true], axis=0) + np.mean(self.missed[rival], axis=0)
        return 1.0 / (frames * (1.0 + about(self.likelihood, missed, round(frames))))


def terms_of(contest: Contest, reference: np.ndarray) -> Terms | None:
    """The terms of a reference (frames, references) [SI]; None if a robot does not come to its end."""
    likelihood = likelihood_on(contest, reference)
    rows = likelihood.residual(contest.robots)
    each = list(zip(contest.explanations, contest.spreads, rows, strict=True))
    columns = [derivatives(likelihood, *one) for one in each]
    missed = [nonlinearity(likelihood, *one, part) for one, part in zip(each, columns, strict=True)]
    whole = all(np.isfinite(part).all() for part in (rows, *missed, *columns))
    return Terms(likelihood, rows, columns, missed) if whole else None


def trial_of(contest: Contest, reference: np.ndarray) -> Trial:
    """A log (frames, columns) that the first explanation would leave on a reference (frames, references) [SI]."""
    problem = contest.problem
    empty = Trial("experiment", "fit", reference, np.zeros((len(reference), len(problem.columns))))
    return replace(empty, measured=problem.predict(contest.robots[:1], empty)[0])


def likelihood_on(contest: Contest, reference: np.ndarray) -> Likelihood:
    """The likelihood of that log, whitened as the logs of the case are."""
    (view,) = contest.likelihood.views
    problem = replace(contest.problem, fit=(trial_of(contest, reference),))
    return Likelihood((replace(view, problem=problem, noise=()),))


def derivatives(likelihood: Likelihood, e: Explanation, spread: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Derivatives (directions, samples) of the residual (samples,) of an explanation along `spread`'s columns."""
    scale = np.array([p.scale for p in e.parameters])[:, None]
    steps = STEP / np.maximum(np.abs(spread / scale).max(axis=0), 1e-12)
    low, high = e.bounds
    moved = e.x + (spread * steps).T
    outside = ((moved < low) | (moved > high)).any(axis=1)
    steps = np.where(outside, -steps, steps)
    rows = [apply(e.values, e.parameters, np.clip(e.x + step * v, low, high)) for step, v in zip(steps, spread.T)]
    return (likelihood.residual(np.array(rows)) - residual) / steps[:, None]


def nonlinearity(
    likelihood: Likelihood, e: Explanation, spread: np.ndarray, residual: np.ndarray, columns: np.ndarray
) -> np.ndarray:
    """Squares (draws, samples) of what drawn changes of the parameters along `spread` miss the linearisation by."""
    draws = np.random.default_rng(0).standard_normal((DRAWS, spread.shape[1]))
    moved = np.clip(e.x + draws @ spread.T, *e.bounds)
    along = np.linalg.lstsq(spread, (moved - e.x).T, rcond=None)[0].T
    rows = np.array([apply(e.values, e.parameters, x) for x in moved])
    return (likelihood.residual(rows) - residual - along @ columns) ** 2


def about(likelihood: Likelihood, squares: np.ndarray, frames: int) -> np.ndarray:
    """Means (samples,) of squares (samples,) over all columns and as many frames about each."""
    from scipy.ndimage import uniform_filter1d

    columns = len(likelihood.views[0].problem.columns)
    course = uniform_filter1d(squares.reshape(-1, columns).mean(axis=1), max(frames, 1), mode="nearest")
    return np.repeat(course, columns)
