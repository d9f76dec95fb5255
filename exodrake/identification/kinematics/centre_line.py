"""Line of a joint centre over the joint angle, with intervals (paper Table 1: X = G theta + Y)."""

from dataclasses import dataclass

import numpy as np

from exodrake.core.confidence import NORMAL_95


@dataclass(frozen=True)
class CentreLine:
    """Centre = gradient theta + intercept, per axis of the frame proximal to the joint.

    Attributes:
        gradient: (3,) [m/rad].
        intercept: (3,) [m].
        covariance: (6, 6) of gradient, then intercept [m2].
        rmse: (3,) scatter about the line of the centres of single frames [m].
        frames: Number of frames with a large enough angle for that scatter.
    """

    gradient: np.ndarray
    intercept: np.ndarray
    covariance: np.ndarray
    rmse: np.ndarray
    frames: int

    @property
    def gradient_interval(self) -> np.ndarray:
        """Half width (3,) of the 95 % interval [m/rad]."""
        return NORMAL_95 * np.sqrt(np.diag(self.covariance)[:3])

    @property
    def intercept_interval(self) -> np.ndarray:
        """Half width (3,) of the 95 % interval [m]."""
        return NORMAL_95 * np.sqrt(np.diag(self.covariance)[3:])

    @property
    def rmse_3d(self) -> float:
        """Root of the sum of squares of the RMSE of the three axes [m]."""
        return float(np.linalg.norm(self.rmse))

    def at(self, angle: np.ndarray) -> np.ndarray:
        """Centre (..., 3) [m] at angles (...) [rad]."""
        return self.intercept + self.gradient * np.asarray(angle)[..., None]

    def band(self, angle: np.ndarray) -> np.ndarray:
        """95 % half width of the line (..., 3) [m] at angles (...) [rad]."""
        theta, (slope, shared, level) = np.asarray(angle)[..., None], self._variances()
        return NORMAL_95 * np.sqrt(np.maximum(theta**2 * slope + 2 * theta * shared + level, 0.0))

    def _variances(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Variance of the gradient, covariance, and variance of the intercept, (3,) each [m2]."""
        return np.diag(self.covariance)[:3], np.diag(self.covariance, 3), np.diag(self.covariance)[3:]
