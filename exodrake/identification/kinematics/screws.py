"""The paper's Eq. 7-18, corrected: exponential, logarithm, the matrix G between them, joint centre and Newton's step.

A screw is S = (w, v) with unit axis w, and v = -w x Q for a pure rotation about the axis through Q.

    e^{[S] theta} = [e^{[w] theta}, G v; 0, 1]
    G      = I theta + (1 - cos theta) [w] + (theta - sin theta) [w]^2
    G^{-1} = I / theta - [w] / 2 + (1/theta - 1/2 cot(theta/2)) [w]^2
    Q      = w x v

This G^{-1} is the corrected one; the printed one has cot(theta/2)/theta in place of cot(theta/2)/2 and does not invert
G (`physics.md` 1.9). Joint angles of a measured pose by Newton's iteration on the space Jacobian (Eq. 14-18):

    T(theta) = e^{[S1] theta1} e^{[S2] theta2} M        A = vee log(T(theta) T^{-1})
    -A = J_s dtheta,   theta <- theta + dtheta          J_s = [S1, Ad(e^{[S1] theta1}) S2]

`identify` does not use them: it adjusts axes, poses and angles to all markers together (`adjust`), which weighs the
markers by their noise. Newton's iteration takes the axes as known and the poses as exact.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from exodrake.core.errors import InputError
from exodrake.identification.kinematics.rigid import Axis, chain_pose, hat, inverse, motion, rotation

NEWTON_STEPS, CONVERGED = 50, 1e-10  # steps at most, and rad: a step below this is the last
SERIES = 1e-2  # rad; below this angle quotients are summed as series, whose next term is under 1e-16


def rotation_vector(matrix: np.ndarray) -> np.ndarray:
    """Rotation vector w theta (..., 3) [rad] with 0 <= theta <= pi of rotations (..., 3, 3) (Eq. 10-11); NaN of NaN."""
    flat = np.reshape(matrix, (-1, 3, 3))
    seen = np.isfinite(flat).all(axis=(1, 2))
    vectors = np.full((len(flat), 3), np.nan)
    if seen.any():
        vectors[seen] = Rotation.from_matrix(flat[seen]).as_rotvec()
    return vectors.reshape(np.shape(matrix)[:-1])


def g_matrix(axis: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    """Matrix G(theta) of Eq. 9, (..., 3, 3), for unit axes (..., 3) and angles (...) [rad]."""
    w, theta = hat(axis), np.asarray(angle, dtype=float)[..., None, None]
    remainder = np.where(np.abs(theta) < SERIES, theta**3 / 6 - theta**5 / 120, theta - np.sin(theta))
    return np.eye(3) * theta + (1 - np.cos(theta)) * w + remainder * (w @ w)


def g_inverse(axis: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    """Corrected G^{-1}(theta) of Eq. 9, (..., 3, 3), for unit axes (..., 3) and angles (...) [rad] other than 0."""
    w, theta = hat(axis), np.asarray(angle, dtype=float)[..., None, None]
    return np.eye(3) / theta - w / 2 + theta * _cotangent(theta) * (w @ w)


def _cotangent(theta: np.ndarray) -> np.ndarray:
    """(1/theta - 1/2 cot(theta/2)) / theta, which is 1/12 at 0."""
    safe = np.where(np.abs(theta) < SERIES, 1.0, theta)
    return np.where(np.abs(theta) < SERIES, 1 / 12 + theta**2 / 720, (1 / safe - 1 / (2 * np.tan(safe / 2))) / safe)


def exponential(screw: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    """Pose e^{[S] theta} (..., 4, 4) (Eq. 8) of screws (..., 6) with unit or zero w, and angles (...) [rad]."""
    w, v = screw[..., :3], screw[..., 3:]
    return motion(rotation(w, angle), np.einsum("...ij,...j->...i", g_matrix(w, angle), v))


def logarithm(pose: np.ndarray) -> np.ndarray:
    """Screw times angle, vee(log T) = (w theta, v theta), (..., 6) [rad, m], of poses (..., 4, 4) (Eq. 15)."""
    vector = rotation_vector(pose[..., :3, :3])
    w = hat(vector)
    theta = np.linalg.norm(vector, axis=-1)[..., None, None]
    undo = np.eye(3) - w / 2 + _cotangent(theta) * (w @ w)
    return np.concatenate([vector, np.einsum("...ij,...j->...i", undo, pose[..., :3, 3])], axis=-1)


def joint_centre(pose: np.ndarray) -> np.ndarray:
    """Centre Q = w x v (..., 3) [m], normal to the axis, of motions (..., 4, 4) about it (Eq. 12); NaN for no rotation.

    Eq. 13, |Q| = |v| / |w|, agrees for a pure rotation only: a slide along the axis adds to |v|, not to w x v.
    """
    screw = logarithm(pose)
    theta = np.linalg.norm(screw[..., :3], axis=-1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.cross(screw[..., :3] / theta, screw[..., 3:] / theta)


def adjoint(pose: np.ndarray) -> np.ndarray:
    """Adjoint [R 0; [p]R R] (..., 6, 6) of poses (..., 4, 4): carries a screw (w, v) to another frame (Eq. 18)."""
    turned = pose[..., :3, :3]
    matrix = np.zeros((*np.shape(pose)[:-2], 6, 6))
    matrix[..., :3, :3] = matrix[..., 3:, 3:] = turned
    matrix[..., 3:, :3] = hat(pose[..., :3, 3]) @ turned
    return matrix


def velocity(axis: Axis, angle: np.ndarray) -> np.ndarray:
    """Spatial velocity per rad (..., 6) of an axis at angles (...) [rad]: (w, -w x Q + (I - R) G) for a moving one."""
    slide = axis.slope - rotation(axis.direction, angle) @ axis.slope
    v = np.cross(axis.centre(angle), axis.direction) + slide
    return np.concatenate([np.broadcast_to(axis.direction, v.shape), v], axis=-1)


def space_jacobian(axes: Sequence[Axis], angles: np.ndarray) -> np.ndarray:
    """Space Jacobian (frames, 6, axes), rows (w, v), at angles (frames, axes) [rad] (Eq. 17-18)."""
    columns, pose = [velocity(axes[0], angles[:, 0])], axes[0].pose(angles[:, 0])
    for number, axis in enumerate(axes[1:], start=1):
        columns.append(np.einsum("fij,fj->fi", adjoint(pose), velocity(axis, angles[:, number])))
        pose = pose @ axis.pose(angles[:, number])
    return np.stack(columns, axis=2)


def newton_step(axes: Sequence[Axis], turns: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Step dtheta (frames, axes) [rad] for measured T M^{-1} (frames, 4, 4): least squares of six equations."""
    error = logarithm(chain_pose(axes, angles) @ inverse(turns))
    return -np.einsum("fai,fi->fa", np.linalg.pinv(space_jacobian(axes, angles)), error)


def joint_angles(axes: Sequence[Axis], turns: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
    """Angles of a joint with one or more axes by Newton's iteration on the space Jacobian (Eq. 14-18).

    Args:
        axes: from the proximal one to the distal one; for the MCP abduction and flexion.
        turns: (frames, 4, 4) measured T M^{-1}, motions from the reference posture [m]; NaN where there is none.
        start: (frames, axes) initial guess [rad]; 0 if None.

    Returns:
        Angles (frames, axes) [rad], NaN where the motion is.

    Raises:
        InputError: if the iteration does not converge in a frame.
    """
    seen = np.isfinite(turns).all(axis=(1, 2))
    angles = np.zeros((len(turns), len(axes))) if start is None else np.array(start, dtype=float)
    angles[~seen] = np.nan
    left = np.flatnonzero(seen)
    for _ in range(NEWTON_STEPS):
        if not len(left):
            return angles
        step = newton_step(axes, turns[left], angles[left])
        angles[left] += step
        left = left[np.abs(step).max(axis=1) > CONVERGED]
    raise InputError(f"joint angles: Newton's iteration does not converge in {len(left)} of {len(turns)} frames")
