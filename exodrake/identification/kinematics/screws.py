"""Screws and rigid motions: exponential, logarithm and the matrix G between them (paper Eq. 7-12, 15, 18).

A rigid motion is a 4 x 4 matrix T = [R p; 0 1]; a screw is S = (w, v), w the unit axis and v = -w x Q for a pure
rotation about the axis through Q. Leading axes (`...`) are frames of a recording, everything works on all of them at
once.

    e^{[S] theta} = [e^{[w] theta}, G v; 0, 1]        G      = I theta + (1 - cos theta) [w] + (theta - sin theta) [w]^2
                                                      G^{-1} = I / theta - [w] / 2 + (1/theta - 1/2 cot(theta/2)) [w]^2

G^{-1} is the corrected one: as printed (cot(theta/2)/theta instead of cot(theta/2)/2) it does not invert G
(`physics.md` 1.9). Angles come from atan2, which keeps its digits near 0 where the arc cosine of Eq. 10 loses them.
"""

import numpy as np

SERIES = 1e-2  # below this angle [rad] quotients are summed as series, next term under 1e-16


def hat(w: np.ndarray) -> np.ndarray:
    """[w], the matrix of w x (Eq. 11). w (..., 3); returns (..., 3, 3)."""
    matrix = np.zeros((*np.shape(w), 3))
    matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0] = w[..., 0], w[..., 1], w[..., 2]
    return matrix - np.swapaxes(matrix, -1, -2)


def vee(matrix: np.ndarray) -> np.ndarray:
    """The vector of the antisymmetric part, (M - M^T) / 2. matrix (..., 3, 3); returns (..., 3)."""
    part = (matrix - np.swapaxes(matrix, -1, -2)) / 2
    return np.stack([part[..., 2, 1], part[..., 0, 2], part[..., 1, 0]], axis=-1)


def rotation(axis: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    """e^{[w] theta}, Rodrigues. axis (..., 3) of unit length, angle (...) [rad]; returns (..., 3, 3)."""
    w, theta = hat(axis), np.asarray(angle)[..., None, None]
    return np.eye(3) + np.sin(theta) * w + (1 - np.cos(theta)) * (w @ w)


def rotation_vector(matrix: np.ndarray) -> np.ndarray:
    """w theta with 0 <= theta <= pi (Eq. 10-11 by atan2). matrix (..., 3, 3); returns (..., 3) [rad]."""
    sine = vee(matrix)
    size = np.linalg.norm(sine, axis=-1)
    theta = np.arctan2(size, (np.trace(matrix, axis1=-2, axis2=-1) - 1) / 2)
    small = theta < SERIES
    factor = np.where(small, 1 + theta**2 / 6 + 7 * theta**4 / 360, theta / np.where(size > 0, size, 1))
    vector = factor[..., None] * sine
    half_turn = theta > np.pi - SERIES
    return np.where(half_turn[..., None], theta[..., None] * _axis_of_half_turn(matrix, sine), vector)


def _axis_of_half_turn(matrix: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """Unit axis where R - R^T vanishes: the largest column of R + R^T - (tr R - 1) I, with the sign of what is left of
    w sin theta."""
    trace = np.trace(matrix, axis1=-2, axis2=-1)[..., None, None]
    outer = matrix + np.swapaxes(matrix, -1, -2) - (trace - 1) * np.eye(3)
    lengths = np.linalg.norm(outer, axis=-2)
    column = np.take_along_axis(outer, np.argmax(lengths, axis=-1)[..., None, None], axis=-1)[..., 0]
    axis = column / np.maximum(np.linalg.norm(column, axis=-1), np.finfo(float).tiny)[..., None]
    return np.where(np.sum(axis * sine, axis=-1, keepdims=True) < 0, -axis, axis)


def g_matrix(axis: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    """G(theta) of Eq. 9. axis (..., 3) of unit length, angle (...) [rad]; returns (..., 3, 3)."""
    w, theta = hat(axis), np.asarray(angle, dtype=float)[..., None, None]
    remainder = np.where(np.abs(theta) < SERIES, theta**3 / 6 - theta**5 / 120, theta - np.sin(theta))
    return np.eye(3) * theta + (1 - np.cos(theta)) * w + remainder * (w @ w)


def g_inverse(axis: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    """G^{-1}(theta) of Eq. 9, corrected. axis (..., 3) of unit length, angle (...) [rad], not 0; returns (..., 3,
    3)."""
    w, theta = hat(axis), np.asarray(angle, dtype=float)[..., None, None]
    return np.eye(3) / theta - w / 2 + theta * _cotangent(theta) * (w @ w)


def g_inverse_as_printed(axis: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    """G^{-1}(theta) as Eq. 9 stands in our copy of the paper, for comparison only: right at 2 rad and nowhere else."""
    w, theta = hat(axis), np.asarray(angle, dtype=float)[..., None, None]
    return np.eye(3) / theta - w / 2 + (1 - 1 / np.tan(theta / 2)) / theta * (w @ w)


def _cotangent(theta: np.ndarray) -> np.ndarray:
    """(1/theta - 1/2 cot(theta/2)) / theta, which is 1/12 at 0."""
    safe = np.where(np.abs(theta) < SERIES, 1.0, theta)
    return np.where(np.abs(theta) < SERIES, 1 / 12 + theta**2 / 720, (1 / safe - 1 / (2 * np.tan(safe / 2))) / safe)


def motion(matrix: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """T = [R p; 0 1]. matrix (..., 3, 3), shift (..., 3) [m]; returns (..., 4, 4)."""
    pose = np.zeros((*np.shape(matrix)[:-2], 4, 4))
    pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = matrix, shift, 1
    return pose


def inverse(pose: np.ndarray) -> np.ndarray:
    """T^{-1} = [R^T, -R^T p; 0 1] (the paper's P_MF = -R_MF P_M, Eq. 6). pose (..., 4, 4)."""
    turned = np.swapaxes(pose[..., :3, :3], -1, -2)
    return motion(turned, -np.einsum("...ij,...j->...i", turned, pose[..., :3, 3]))


def apply(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points in the other frame, X_M = T_MF X_F (Eq. 4). pose (..., 4, 4), points (..., k, 3) [m]; returns (..., k,
    3)."""
    return points @ np.swapaxes(pose[..., :3, :3], -1, -2) + pose[..., None, :3, 3]


def exponential(screw: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    """e^{[S] theta} (Eq. 8). screw (..., 6) with unit or zero w, angle (...) [rad]; returns (..., 4, 4)."""
    w, v = screw[..., :3], screw[..., 3:]
    return motion(rotation(w, angle), np.einsum("...ij,...j->...i", g_matrix(w, angle), v))


def logarithm(pose: np.ndarray) -> np.ndarray:
    """vee(log T) = (w theta, v theta), the inverse of `exponential` (Eq. 15). pose (..., 4, 4); returns (..., 6) [rad,
    m]."""
    vector = rotation_vector(pose[..., :3, :3])
    w = hat(vector)
    theta = np.linalg.norm(vector, axis=-1)[..., None, None]
    undo = np.eye(3) - w / 2 + _cotangent(theta) * (w @ w)
    return np.concatenate([vector, np.einsum("...ij,...j->...i", undo, pose[..., :3, 3])], axis=-1)


def adjoint(pose: np.ndarray) -> np.ndarray:
    """Ad_T = [R 0; [p]R R], which carries a screw (w, v) to another frame (Eq. 18). pose (..., 4, 4); returns (..., 6,
    6)."""
    turned = pose[..., :3, :3]
    matrix = np.zeros((*np.shape(pose)[:-2], 6, 6))
    matrix[..., :3, :3] = matrix[..., 3:, 3:] = turned
    matrix[..., 3:, :3] = hat(pose[..., :3, 3]) @ turned
    return matrix


def screw_angle_and_centre(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit axis w (..., 3), angle (...) [rad] and Q = w x v (..., 3) [m], the axis's point nearest the origin (Eq.
    10-12).

    Q's place along the axis cannot be observed; sliding along it does not disturb Q, as Eq. 13 would. All NaN where
    nothing turns.
    """
    vector = logarithm(pose)
    angle = np.linalg.norm(vector[..., :3], axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = vector / angle[..., None]
    return unit[..., :3], angle, np.cross(unit[..., :3], unit[..., 3:])
