"""Equations 9 and 22 as our copy of the paper prints them, for comparison with the corrected ones only."""

import numpy as np

from exodrake.identification.kinematics.rigid import hat
from exodrake.identification.statics import tension_map_with


def g_inverse_as_printed(axis: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    """G^{-1}(theta) (..., 3, 3) of Eq. 9 as printed, right at 2 rad only; axis (..., 3), angle (...) [rad]."""
    w, theta = hat(axis), np.asarray(angle, dtype=float)[..., None, None]
    return np.eye(3) / theta - w / 2 + (1 - 1 / np.tan(theta / 2)) / theta * (w @ w)


def tension_map_as_printed(r: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """J^{-1} (3, 3) [N/rad] of Eq. 22 as printed: entry (2, 1) is kappa_1, in another unit than its neighbours."""
    return tension_map_with(r, kappa, kappa[0])
