"""The paper's joint angles (Eq. 14-18), and Eq. 9 and 22 in closed form, as printed and corrected."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from exodrake.core.errors import InputError
from exodrake.identification.kinematics.rigid import Axis, chain_poses, hat, inverse, space_jacobian

NEWTON_STEPS, CONVERGED = 50, 1e-10  # steps at most, and rad: a step below this is the last


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


def joint_angles(axes: Sequence[Axis], turns: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
    """The paper's angles of a joint with one or more axes by Newton's iteration on the space Jacobian (Eq. 14-18).

        T(theta) = e^{[S1] theta1} e^{[S2] theta2} M        A = vee log(T(theta) T^{-1})
        -A = J_s dtheta,   theta <- theta + dtheta          J_s = [S1, Ad(e^{[S1] theta1}) S2]

    It takes axes, the proximal one first, as known and poses as exact; `adjust` weighs all markers by their noise
    instead. `turns` (frames, 4, 4) are measured T M^{-1} [m], NaN where there is none. Returns angles (frames, axes)
    [rad], from a start of that shape, or from 0. InputError if the iteration does not converge in a frame.
    """
    seen = np.isfinite(turns).all(axis=(1, 2))
    angles = np.zeros((len(turns), len(axes))) if start is None else np.array(start, dtype=float)
    angles[~seen] = np.nan
    left = np.flatnonzero(seen)
    for _ in range(NEWTON_STEPS):
        if not len(left):
            return angles
        pose = chain_poses(axes, angles[left])[-1]
        error = RigidTransform.from_matrix(pose @ inverse(turns[left])).as_exp_coords()
        step = -np.einsum("fai,fi->fa", np.linalg.pinv(space_jacobian(axes, angles[left])), error)
        angles[left] += step
        left = left[np.abs(step).max(axis=1) > CONVERGED]
    raise InputError(f"joint angles: Newton's iteration does not converge in {len(left)} of {len(turns)} frames")
