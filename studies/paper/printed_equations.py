"""Equations 9 and 22 in closed form, as our copy of the paper prints them and corrected."""

import numpy as np

from exodrake.identification.kinematics.rigid import hat


def g_matrix(axis: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    """G(theta) (..., 3, 3) of Eq. 9; axis (..., 3), angle (...) [rad]."""
    w, theta = hat(axis), np.asarray(angle, dtype=float)[..., None, None]
    return np.eye(3) * theta + (1 - np.cos(theta)) * w + (theta - np.sin(theta)) * (w @ w)


def g_inverse(axis: np.ndarray, angle: np.ndarray | float, printed: bool = False) -> np.ndarray:
    """G^{-1}(theta) (..., 3, 3) of Eq. 9: corrected, or as printed, right at 2 rad only; angle [rad], not 0."""
    w, theta = hat(axis), np.asarray(angle, dtype=float)[..., None, None]
    cotangent = 1 / np.tan(theta / 2)
    last = (1 - cotangent) / theta if printed else 1 / theta - cotangent / 2
    return np.eye(3) / theta - w / 2 + last * (w @ w)


def tension_map_as_printed(r: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """J^{-1} (3, 3) [N/rad] of Eq. 22 as printed: entry (2, 1) is kappa_1, in another unit than its neighbours."""
    d, k = r[1, 0] * r[2, 2] - r[1, 2] * r[2, 0], kappa
    second = k[1] * (r[0, 2] * r[2, 0] - r[0, 0] * r[2, 2]) / r[0, 1]
    third = k[2] * (r[0, 0] * r[1, 2] - r[0, 2] * r[1, 0]) / r[0, 1]
    rows = [[0.0, k[1] * r[2, 2], -k[2] * r[1, 2]], [k[0] * d, second, third], [0.0, k[1] * r[2, 0], -k[2] * r[1, 0]]]
    return np.array(rows) / d
