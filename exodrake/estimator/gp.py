"""Gaussian process over sweeps: closed-form leave-one-sweep-out, and the flat arrays for prediction.

`prior.learn` fits the covariance; `condition` conditions on the training rows and calibrates; `fit` does both, and
learns the strokes that show the zeros of a session (`stroke_zeros`).

The prediction of sweep B from the other sweeps follows from K = L L' without a new fit (Rasmussen and Williams, section
5.4.2, with a block in place of a point):

    y_B - mu_B = [K^-1]_BB^-1 [K^-1 y]_B          Cov(y_B | the other sweeps) = [K^-1]_BB^-1

The residuals scale the standard deviation of each joint, and the variances set the limit beyond which a sample is
flagged.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from exodrake.core.confidence import NORMAL_95
from exodrake.core.errors import InputError
from exodrake.core.text import short_repr
from exodrake.core.threads import thread_limit
from exodrake.estimator.dataset import Sweeps
from exodrake.estimator.kernels import parts
from exodrake.estimator.prior import JITTER, POINTS, Prior, learn
from exodrake.estimator.stroke_zeros import StrokeModel, Zeros, learn_strokes
from exodrake.physics.gp_estimator import Weights, predict_rows

# Quantile of the held-out variances that is the limit; new sweeps at trained levels exceed it about 1 % of the time
OWN = 0.975
# The hyperparameters were learnt with the held-out sweep included, so residuals are too small: measured on new sweeps
ALLOWANCE = 1.1


@short_repr
@dataclass(frozen=True, eq=False)
class Estimator:
    """Trained estimator.

    Attributes:
        wires: Names of the wires.
        joints: Names of the joints.
        weights: Arrays of the prediction.
        limit: Variance ratio (see `predict_into`) beyond which a sample is unlike the training sweeps [-].
        robot: Signature of the robot file, or "".
        logs: Names of the training logs.
        sweeps: Number of training sweeps.
        kernel: The covariance, as text.
        strokes: Strokes that the training shows at its tensions, for the zeros of a session; None if not learnt.
    """

    wires: tuple[str, ...]
    joints: tuple[str, ...]
    weights: Weights
    limit: float
    robot: str = ""
    logs: tuple[str, ...] = ()
    sweeps: int = 0
    kernel: str = ""
    strokes: StrokeModel | None = None

    @cached_property
    def points(self) -> int:
        """Number of training points."""
        return len(self.weights.alpha)

    def predict(self, tension: np.ndarray, stroke: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Predict joint angles.

        The flag is that of a sample: `zeros` finds re-donning with a whole session. It does not detect contact with an
        object, which changes tension and stroke along combinations seen in training.

        Args:
            tension: (rows, wires) [N].
            stroke: (rows, wires) [m].

        Returns:
            Mean (rows, joints) [rad], standard deviation (rows, joints) [rad], and flag (rows,) of samples unlike the
            training sweeps.
        """
        mean, std, ratio = predict_rows(np.ascontiguousarray(tension), np.ascontiguousarray(stroke), self.weights)
        return mean, std, ratio > self.limit

    def zeros(self, session: Sweeps) -> Zeros:
        """Estimate the zeros of the strokes of a session and test whether they moved since the training.

        Raises:
            InputError: If the estimator has no model of the strokes, as in files of earlier versions.
        """
        if self.strokes is None:
            raise InputError("estimator without a model of the strokes: train it again to find the zeros of a session")
        return self.strokes.zeros(session)

    def corrected(self, zeros: Zeros, session: Sweeps) -> "Estimator":
        """Move the zeros of the estimator to those of a session.

        The standard deviations grow by the uncertainty of the zeros, in the mean over the session: the result is an
        estimator like any other, for the Diagram too.
        """
        wires, weights, some = len(self.wires), self.weights, session.equispaced(POINTS)
        moved = replace(self, weights=weights._replace(center=weights.center + np.r_[np.zeros(wires), zeros.shift]))
        mean, std, _ = moved.predict(some.tension, some.stroke)
        ways = np.linalg.cholesky(zeros.covariance).T
        added = [moved.predict(some.tension, some.stroke + way)[0] - mean for way in ways]
        wider = np.sqrt(1 + np.mean(np.sum(np.square(added), axis=0), axis=0) / np.mean(std**2, axis=0))
        return replace(moved, weights=moved.weights._replace(spread=weights.spread * wider))


def fit(sweeps: Sweeps, points: int = POINTS) -> Estimator:
    """Learn the covariance, condition on at most `points` rows equispaced in time, and learn the strokes."""
    return replace(condition(learn(sweeps, points), sweeps, points), strokes=learn_strokes(sweeps))


def condition(prior: Prior, sweeps: Sweeps, points: int = POINTS) -> Estimator:
    """Condition on at most `points` rows with a given covariance, and calibrate by leave-one-sweep-out."""
    chosen = sweeps.equispaced(points)
    rows, targets = prior.rows(chosen), prior.targets(chosen)
    with thread_limit():
        factor = np.linalg.cholesky(prior.kernel(rows) + JITTER * np.eye(len(rows)))
        lower = solve_triangular(factor, np.eye(len(rows)), lower=True)
        inverse = lower.T @ lower
        residual, variance = leave_one_sweep_out(inverse, targets, chosen.sweep)
    linear, curved, length, rest = parts(prior.kernel)
    scale = ALLOWANCE / NORMAL_95 * np.quantile(np.abs(residual) / np.sqrt(variance)[:, None], 0.95, axis=0)
    weights = Weights(
        center=prior.center,
        rotation=np.ascontiguousarray(prior.rotation),
        points=np.ascontiguousarray(rows[:, : prior.rotation.shape[0]].T),
        shrink=1.0 / length,
        variances=np.array([linear, curved, rest]),
        alpha=np.ascontiguousarray(lower.T @ (lower @ targets)),
        factor=np.concatenate([lower[column:, column] for column in range(len(rows))]),
        offset=prior.offset,
        gain=prior.gain,
        spread=prior.gain * scale,
    )
    limit = float(np.quantile(variance / rest, OWN))
    return Estimator(
        chosen.wires, chosen.joints, weights, limit, logs=sweeps.logs, sweeps=sweeps.count, kernel=str(prior.kernel)
    )


def leave_one_sweep_out(inverse: np.ndarray, targets: np.ndarray, sweep: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Predict each row from the other sweeps.

    Args:
        inverse: K^-1 (n, n) [-].
        targets: (n, joints) scaled angles [-].
        sweep: (n,) labels.

    Returns:
        Residual (n, joints) [-] and variance (n,) [-].
    """
    weighted = inverse @ targets
    residual, variance = np.empty_like(targets), np.empty(len(targets))
    for label in np.unique(sweep):
        block = np.flatnonzero(sweep == label)
        covariance = np.linalg.inv(inverse[np.ix_(block, block)])
        residual[block] = covariance @ weighted[block]
        variance[block] = np.diag(covariance)
    return residual, variance
