"""Validation of an estimator by cross-validation, beside baselines; and the estimate of a log.

The Gaussian process keeps the hyperparameters learnt from all rows and is conditioned anew in each fold: a fit per fold
would take minutes, and there are a dozen hyperparameters for thousands of rows. Random rows reward a look-up, since
neighbouring rows are nearly equal: only whole held-out sweeps predict the error on a new sweep.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from exodrake.core.confidence import NORMAL_95
from exodrake.core.parallel import thread_limit
from exodrake.data.log import Log
from exodrake.estimator.dataset import Sweeps, read_session
from exodrake.estimator.gp import POINTS, Estimator, Prior, Zeros, condition

PENALTIES = tuple(10.0**power for power in range(-3, 3))
RIDGE_FOLDS = 5

Predictor = Callable[[Sweeps], tuple[np.ndarray, np.ndarray]]
"""Mean and standard deviation (n, joints) [rad] of the angles of sweeps, from their inputs."""


def fit_ridge(sweeps: Sweeps) -> Predictor:
    """Fit a quadratic ridge; penalty and standard deviation by cross-validation; predicts (n, joints) [rad]."""
    from sklearn.linear_model import Ridge
    from sklearn.model_selection import GroupKFold, cross_val_predict

    folds, errors = GroupKFold(min(RIDGE_FOLDS, sweeps.count)), []
    models = [make_pipeline(StandardScaler(), PolynomialFeatures(2), Ridge(penalty)) for penalty in PENALTIES]
    for model in models:
        held_out = cross_val_predict(model, sweeps.inputs, sweeps.angle, groups=sweeps.sweep, cv=folds)
        errors.append(np.sqrt(np.mean((held_out - sweeps.angle) ** 2, axis=0)))
    best = int(np.argmin([error.mean() for error in errors]))
    model = models[best].fit(sweeps.inputs, sweeps.angle)
    return lambda new: (model.predict(new.inputs), np.broadcast_to(errors[best], (len(new), len(errors[best]))))


def fit_nearest(sweeps: Sweeps) -> Predictor:
    """Fit a nearest-neighbour look-up without standard deviation (NaN); predicts (n, joints) [rad]."""
    from sklearn.neighbors import KNeighborsRegressor

    model = make_pipeline(StandardScaler(), KNeighborsRegressor(1)).fit(sweeps.inputs, sweeps.angle)
    return lambda new: (model.predict(new.inputs), np.full((len(new), sweeps.angle.shape[1]), np.nan))


FOLDS = 6
RANDOM, HELD_OUT = "random rows", "held-out sweeps"


@dataclass(frozen=True, eq=False)
class Score:
    """Errors of the predictions of a method under a split of the rows.

    RMSE (joints,) [rad]; coverage (joints,), the fraction of rows within the 95 % interval [-], NaN without intervals;
    and loss, the mean negative log-likelihood per row and joint [nat].
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

    def fit_process(part: Sweeps) -> Predictor:
        estimator = condition(prior, part, points)
        return lambda new: estimator.predict(new.tension, new.stroke)[:2]

    labels, row = np.unique(sweeps.sweep, return_inverse=True)
    splits = {
        RANDOM: np.random.default_rng(seed).permutation(len(sweeps)) % FOLDS,
        HELD_OUT: (np.random.default_rng(seed).permutation(len(labels)) % min(FOLDS, len(labels)))[row],
    }
    methods = {"Gaussian process": fit_process, "quadratic ridge": fit_ridge, "nearest row": fit_nearest}
    scores = []
    with thread_limit():  # many small products: a second thread only waits
        for (method, fit), (split, folds) in product(methods.items(), splits.items()):
            mean, std = np.empty_like(sweeps.angle), np.empty_like(sweeps.angle)
            for fold in np.unique(folds):
                inside = folds == fold
                mean[inside], std[inside] = fit(sweeps.rows(~inside))(sweeps.rows(inside))
            scores.append(score(method, split, sweeps.angle, mean, std))
    return tuple(scores)


@dataclass(frozen=True, eq=False)
class Estimate:
    """A log with `angle_est` and `angle_std` columns, and the fraction of samples unlike the training sweeps [-].

    The score is over the rows with measured angles, None without any; zeros of the strokes against the training, None
    of an estimator that cannot tell.
    """

    log: Log
    flagged: float
    score: Score | None
    zeros: Zeros | None


def estimate(estimator: Estimator, log: Log, correct: bool = True) -> Estimate:
    """Joint angles of a log, a session of its own; `correct`: its strokes follow a change of their zeros."""
    session = read_session(log, estimator.wires, estimator.joints)
    zeros = estimator.zeros(session) if estimator.strokes else None
    if correct and zeros is not None and zeros.moved:
        estimator = estimator.correct_zeros(zeros, session)
    mean, std, flag = estimator.predict(session.tension, session.stroke)
    new = log.with_array("angle_est", estimator.joints, mean).with_array("angle_std", estimator.joints, std)
    seen = np.isfinite(session.angle).all(axis=1)
    judged = score("estimator", log.label, session.angle[seen], mean[seen], std[seen]) if seen.any() else None
    return Estimate(new, float(np.mean(flag)), judged, zeros)
