"""Linear regression of the joint centre on the joint angle, with intervals (paper Table 1: X = G theta + Y).

The error of a centre grows as 1/theta (`physics.md` 1.13), so frames are weighted and those below a smallest angle
are left out. Errors of neighbouring frames are correlated (skin, smoothing), so the intervals use the larger of the
classical covariance and the cluster-robust (sandwich) covariance over blocks of frames.
"""

from dataclasses import dataclass

import numpy as np

NORMAL_95 = 1.959963984540054  # normal quantile of 0.975


@dataclass(frozen=True)
class CentreLine:
    """Centre = gradient theta + intercept, per axis of the frame proximal to the joint.

    Attributes:
        gradient: (3,) [m/rad].
        intercept: (3,) [m].
        rmse: (3,) over the frames used [m].
        gradient_interval: (3,) half width of the 95 % interval [m/rad].
        intercept_interval: (3,) half width of the 95 % interval [m].
        correlation: (3,) of gradient and intercept [-].
        covariance: (3, 3) of the intercept [m2].
        frames: Number of frames used.
    """

    gradient: np.ndarray
    intercept: np.ndarray
    rmse: np.ndarray
    gradient_interval: np.ndarray
    intercept_interval: np.ndarray
    correlation: np.ndarray
    covariance: np.ndarray
    frames: int

    @property
    def rmse_3d(self) -> float:
        """Root of the sum of squares of the RMSE of the three axes [m]."""
        return float(np.linalg.norm(self.rmse))

    def at(self, angle: np.ndarray) -> np.ndarray:
        """Centre (..., 3) [m] at angles (...) [rad]."""
        return self.intercept + self.gradient * np.asarray(angle)[..., None]

    def band(self, angle: np.ndarray) -> np.ndarray:
        """95 % half width of the line (..., 3) [m] at angles (...) [rad]."""
        slope, rise = np.asarray(angle)[..., None] * self.gradient_interval, self.intercept_interval
        return np.sqrt(np.maximum(slope**2 + rise**2 + 2 * self.correlation * slope * rise, 0.0))


def centre_line(angle: np.ndarray, centre: np.ndarray, weight: np.ndarray, block: int) -> CentreLine:
    """Regress the centre on the angle.

    Args:
        angle: (frames,) joint angle [rad].
        centre: (frames, 3) joint centre [m].
        weight: (frames,) weight of each frame [-].
        block: Number of frames within which errors may be correlated.
    """
    design = np.stack([angle, np.ones_like(angle)], axis=1)
    normal = np.linalg.inv(design.T @ (weight[:, None] * design))
    answer = normal @ (design.T @ (weight[:, None] * centre))
    error = centre - design @ answer
    joint = _covariance(design, error, weight, normal, block)
    variances = np.einsum("iijj->ij", joint)
    half = NORMAL_95 * np.sqrt(variances)
    shared = np.einsum("jj->j", joint[0, 1]) / np.maximum(np.sqrt(variances[0] * variances[1]), np.finfo(float).tiny)
    rmse = np.sqrt(np.mean(error**2, axis=0))
    return CentreLine(answer[0], answer[1], rmse, half[0], half[1], shared, joint[1, 1], len(angle))


def _covariance(
    design: np.ndarray, error: np.ndarray, weight: np.ndarray, normal: np.ndarray, block: int
) -> np.ndarray:
    """Covariance (2, 2, 3, 3) of (gradient, intercept) x axes: classical or sandwich, by the larger trace."""
    frames = len(error)
    spread = error.T @ (weight[:, None] * error) / max(frames - 2, 1)
    classical = normal[:, :, None, None] * spread
    scores = weight[:, None, None] * design[:, :, None] * error[:, None, :]
    sums = np.add.reduceat(scores, np.arange(0, frames, block), axis=0)
    leverage = np.einsum("ij,bjk->bik", normal, sums)
    groups = len(sums)
    sandwich = groups / max(groups - 2, 1) * np.einsum("bik,bjl->ijkl", leverage, leverage)
    return max((classical, sandwich), key=lambda covariance: float(np.trace(covariance[1, 1])))
