"""Baselines: a quadratic ridge with a standard deviation from held-out sweeps, and the nearest neighbour.

With wearer variability the Gaussian process gains over the ridge in its likelihood rather than its RMSE. The nearest
neighbour exposes a random split: it is good at looking up rows of the same sweep and poor on a new sweep.
"""

from collections.abc import Callable

import numpy as np

from exodrake.estimator.dataset import Sweeps

PENALTIES = tuple(10.0**power for power in range(-3, 3))
FOLDS = 5

Predictor = Callable[[Sweeps], tuple[np.ndarray, np.ndarray]]
"""Mean and standard deviation (n, joints) [rad] of the angles of sweeps, from their inputs."""


def fit_ridge(sweeps: Sweeps) -> Predictor:
    """Fit a quadratic ridge; penalty and standard deviation by cross-validation; predicts (n, joints) [rad]."""
    from sklearn.model_selection import GroupKFold, cross_val_predict

    folds = GroupKFold(min(FOLDS, sweeps.count))
    errors = []
    for penalty in PENALTIES:
        held_out = cross_val_predict(_quadratic(penalty), sweeps.inputs, sweeps.angle, groups=sweeps.sweep, cv=folds)
        errors.append(np.sqrt(np.mean((held_out - sweeps.angle) ** 2, axis=0)))
    best = int(np.argmin([error.mean() for error in errors]))
    model = _quadratic(PENALTIES[best]).fit(sweeps.inputs, sweeps.angle)
    return lambda new: (model.predict(new.inputs), np.broadcast_to(errors[best], (len(new), len(errors[best]))))


def fit_nearest(sweeps: Sweeps) -> Predictor:
    """Fit a nearest-neighbour look-up without standard deviation (NaN); predicts (n, joints) [rad]."""
    from sklearn.neighbors import KNeighborsRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    model = make_pipeline(StandardScaler(), KNeighborsRegressor(1)).fit(sweeps.inputs, sweeps.angle)
    return lambda new: (model.predict(new.inputs), np.full((len(new), sweeps.angle.shape[1]), np.nan))


def _quadratic(penalty: float):
    from sklearn.linear_model import Ridge
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import PolynomialFeatures, StandardScaler

    return make_pipeline(StandardScaler(), PolynomialFeatures(2), Ridge(penalty))
