"""Covariance of the estimator: hyperparameters by marginal likelihood, scaling, and the inputs of the kernel.

`learn` fits the hyperparameters with scikit-learn's GaussianProcessRegressor (marginal likelihood summed over the
outputs, which share the covariance up to scale). Inputs are rotated to the principal axes of their correlation, since
combinations such as s - T / k carry the information.
"""

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from exodrake.core.threads import thread_limit
from exodrake.estimator.dataset import Sweeps
from exodrake.estimator.kernels import sweep_kernel

POINTS = 500
JITTER = 1e-10  # scikit-learn's default, added to the diagonal
EVALUATIONS = 60  # of the marginal likelihood, which has converged by then


@dataclass(frozen=True, eq=False)
class Prior:
    """Covariance and scaling: kernel over (z, sweep, time) with z = rotation (x - center), angle = offset + gain y."""

    kernel: Any
    center: np.ndarray
    rotation: np.ndarray
    offset: np.ndarray
    gain: np.ndarray

    def rows(self, sweeps: Sweeps) -> np.ndarray:
        """Inputs of the kernel (n, m + 2): z [-], sweep label, time [s]."""
        return np.column_stack([(sweeps.inputs - self.center) @ self.rotation.T, sweeps.sweep, sweeps.time])

    def targets(self, sweeps: Sweeps) -> np.ndarray:
        """Scaled angles (n, joints) [-]."""
        return (sweeps.angle - self.offset) / self.gain


def learn(sweeps: Sweeps, points: int = POINTS) -> Prior:
    """Fit scaling and hyperparameters by marginal likelihood, from the start values of `sweep_kernel`."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor

    chosen = sweeps.equispaced(points)
    prior = scaled(chosen)
    process = GaussianProcessRegressor(prior.kernel, alpha=JITTER, optimizer=_minimise)  # pyright: ignore
    with thread_limit(), warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a variance at its lower bound is an effect that is absent
        process.fit(prior.rows(chosen), prior.targets(chosen))
    return replace(prior, kernel=process.kernel_)


def scaled(sweeps: Sweeps) -> Prior:
    """Scale inputs and angles to unit variance; constant ones keep unit scale."""
    center, width = sweeps.inputs.mean(axis=0), sweeps.inputs.std(axis=0)
    width = np.where(width > 0, width, 1.0)
    unit = (sweeps.inputs - center) / width
    _, axes = np.linalg.eigh(unit.T @ unit)
    gain = sweeps.angle.std(axis=0)
    gain = np.where(gain > 0, gain, 1.0)
    return Prior(sweep_kernel(len(center)), center, axes.T / width, sweeps.angle.mean(axis=0), gain)


def _minimise(objective, start, bounds):
    """Optimizer of scikit-learn: L-BFGS-B with a bounded number of evaluations, each of which costs n^3."""
    from scipy.optimize import minimize

    options = {"maxfun": EVALUATIONS}
    found = minimize(objective, start, method="L-BFGS-B", jac=True, bounds=bounds, options=options)
    return found.x, found.fun
