"""Validation of an estimator by cross-validation over random rows and over whole sweeps.

The Gaussian process keeps the hyperparameters learnt from all rows and is conditioned anew in each fold: a fit per fold
would take minutes, and there are a dozen hyperparameters for thousands of rows. Folds are seeded.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from exodrake.core.confidence import NORMAL_95
from exodrake.core.threads import thread_limit
from exodrake.estimator.baselines import Predictor, fit_nearest, fit_ridge
from exodrake.estimator.dataset import Sweeps
from exodrake.estimator.gp import condition
from exodrake.estimator.prior import POINTS, Prior

FOLDS = 6
RANDOM, HELD_OUT = "random rows", "held-out sweeps"


@dataclass(frozen=True, eq=False)
class Score:
    """Errors of predictions.

    Attributes:
        method: Name of the method.
        split: Name of the split.
        rmse: (joints,) root mean square error [rad].
        coverage: (joints,) fraction of rows within the 95 % interval [-], NaN without intervals.
        loss: Mean negative log-likelihood per row and joint [nat].
    """

    method: str
    split: str
    rmse: np.ndarray
    coverage: np.ndarray
    loss: float

    @property
    def mean_rmse(self) -> float:
        """Mean over the joints [rad]."""
        return float(np.mean(self.rmse))


def score(method: str, split: str, angle: np.ndarray, mean: np.ndarray, std: np.ndarray) -> Score:
    """Score predictions: angle, mean and std are (n, joints) [rad]."""
    error = mean - angle
    sure = np.isfinite(std).all()
    coverage = np.mean(np.abs(error) <= NORMAL_95 * std, axis=0) if sure else np.full(angle.shape[1], np.nan)
    loss = float(np.mean(0.5 * (error / std) ** 2 + np.log(std) + 0.5 * np.log(2 * np.pi))) if sure else float("nan")
    return Score(method, split, np.sqrt(np.mean(error**2, axis=0)), coverage, loss)


def validate(prior: Prior, sweeps: Sweeps, points: int = POINTS, seed: int = 0) -> tuple[Score, ...]:
    """Score Gaussian process, quadratic ridge and nearest neighbour under both splits: six scores, by method."""
    methods: dict[str, Callable[[Sweeps], Predictor]] = {
        "Gaussian process": lambda part: _process(prior, part, points),
        "quadratic ridge": fit_ridge,
        "nearest row": fit_nearest,
    }
    splits = {RANDOM: random_folds(sweeps, seed), HELD_OUT: sweep_folds(sweeps, seed)}
    with thread_limit():  # many small products: a second thread only waits
        return tuple(
            score(method, split, sweeps.angle, *out_of_fold(fit, sweeps, folds))
            for method, fit in methods.items()
            for split, folds in splits.items()
        )


def out_of_fold(fit: Callable[[Sweeps], Predictor], sweeps: Sweeps, folds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (n, joints) [rad] of each row from a fit without its fold; folds (n,)."""
    mean, std = np.empty_like(sweeps.angle), np.empty_like(sweeps.angle)
    for fold in np.unique(folds):
        inside = folds == fold
        mean[inside], std[inside] = fit(sweeps.rows(~inside))(sweeps.rows(inside))
    return mean, std


def random_folds(sweeps: Sweeps, seed: int) -> np.ndarray:
    """Fold (n,) [-] of each row, random over rows: an optimistic split."""
    return np.random.default_rng(seed).permutation(len(sweeps)) % FOLDS


def sweep_folds(sweeps: Sweeps, seed: int) -> np.ndarray:
    """Fold (n,) [-] of each row, random over sweeps."""
    labels, row = np.unique(sweeps.sweep, return_inverse=True)
    folds = np.random.default_rng(seed).permutation(len(labels)) % min(FOLDS, len(labels))
    return folds[row]


def _process(prior: Prior, sweeps: Sweeps, points: int) -> Predictor:
    estimator = condition(prior, sweeps, points)
    return lambda new: estimator.predict(new.tension, new.stroke)[:2]
