"""Joint angles from a measured pose by Newton's iteration on the space Jacobian (paper Eq. 14-18).

    T(theta) = e^{[S1] theta1} e^{[S2] theta2} M        A = vee log(T(theta) T^{-1})
    -A = J_s dtheta,   theta <- theta + dtheta          J_s = [S1, Ad(e^{[S1] theta1}) S2]

There are six equations, one unknown per axis, and A has mixed units. Its norm is therefore taken in the metric of the
markers: equal noise on every marker gives a frame the information W = sum over its markers x of |w x x + v|^2, and the
pose of one frame relative to another the information (W1^{-1} + W2^{-1})^{-1}.
"""

from collections.abc import Sequence

import numpy as np

from exodrake.identification.kinematics.axis import Axis
from exodrake.identification.kinematics.screws import adjoint, apply, hat, inverse, logarithm

ITERATIONS = 30  # iterations allowed; a finger needs 4 to 6
SMALL = 1e-12  # rad; last step of a converged iteration


def chain_pose(axes: Sequence[Axis], angles: np.ndarray) -> np.ndarray:
    """Product (frames, 4, 4) of the motions of the axes at angles (frames, axes) [rad] (Eq. 14 without M)."""
    pose = axes[0].pose(angles[:, 0])
    for number, axis in enumerate(axes[1:], start=1):
        pose = pose @ axis.pose(angles[:, number])
    return pose


def space_jacobian(axes: Sequence[Axis], angles: np.ndarray) -> np.ndarray:
    """Space Jacobian (frames, 6, axes), rows (w, v), at angles (frames, axes) [rad] (Eq. 17-18)."""
    columns, pose = [axes[0].velocity(angles[:, 0])], axes[0].pose(angles[:, 0])
    for number, axis in enumerate(axes[1:], start=1):
        columns.append(np.einsum("fij,fj->fi", adjoint(pose), axis.velocity(angles[:, number])))
        pose = pose @ axis.pose(angles[:, number])
    return np.stack(columns, axis=2)


def marker_metric(points: np.ndarray) -> np.ndarray:
    """Information (..., 6, 6) with (w, v)^T W (w, v) = sum over markers (..., k, 3) [m] of |w x x + v|^2."""
    lever = np.concatenate([-hat(points), np.broadcast_to(np.eye(3), (*points.shape, 3))], axis=-1)
    return np.einsum("...kij,...kil->...jl", lever, lever)


def pose_metric(turns: np.ndarray, markers: np.ndarray, proximal: np.ndarray) -> np.ndarray:
    """Metric of the error of each measured motion, from the noise of both triads.

    Args:
        turns: (frames, 4, 4) motions of the distal segment from the reference posture [m].
        markers: (3, 3) markers of the distal segment in that posture [m].
        proximal: (3, 3) markers of the proximal segment [m].

    Returns:
        Metric (frames, 6, 6).
    """
    distal = np.linalg.inv(marker_metric(apply(turns, markers)))
    return np.linalg.inv(distal + np.linalg.inv(marker_metric(proximal)))


def newton_step(axes: Sequence[Axis], turns: np.ndarray, metric: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Step dtheta (frames, axes) [rad] of one iteration for measured T M^{-1} (frames, 4, 4), as in `joint_angles`."""
    error = logarithm(chain_pose(axes, angles) @ inverse(turns))
    jacobian = space_jacobian(axes, angles)
    weighted = np.swapaxes(jacobian, 1, 2) @ metric
    return -np.linalg.solve(weighted @ jacobian, (weighted @ error[..., None]))[..., 0]


def joint_angles(axes: Sequence[Axis], turns: np.ndarray, metric: np.ndarray) -> np.ndarray:
    """Fit joint angles to measured motions.

    Args:
        axes: Joint axes, proximal first.
        turns: (frames, 4, 4) motions from the reference posture in the proximal frame [m].
        metric: (frames, 6, 6) of `pose_metric`.

    Returns:
        Angles (frames, axes) [rad], NaN where the iteration does not converge.
    """
    start = logarithm(turns)[:, :3]
    angles = np.stack([start @ axis.direction for axis in axes], axis=1)
    left = np.full(len(turns), np.inf)
    for _ in range(ITERATIONS):
        step = newton_step(axes, turns, metric, angles)
        angles, left = angles + step, np.max(np.abs(step), axis=1)
        if np.max(left, initial=0.0) < SMALL:
            break
    angles[left > np.sqrt(SMALL)] = np.nan
    return angles
