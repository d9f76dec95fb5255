"""Rotations and rigid motions as matrices: R (3, 3), and T = [R p; 0 1] (4, 4).

All functions act on the leading axes (`...`), which are frames of a recording.
"""

import numpy as np
from scipy.spatial.transform import Rotation


def hat(w: np.ndarray) -> np.ndarray:
    """Matrix [w] of the cross product w x (Eq. 11): (..., 3) [-] to (..., 3, 3) [-]."""
    matrix = np.zeros((*np.shape(w), 3))
    matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0] = w[..., 0], w[..., 1], w[..., 2]
    return matrix - np.swapaxes(matrix, -1, -2)


def vee(matrix: np.ndarray) -> np.ndarray:
    """Vector of the antisymmetric part (M - M^T) / 2: (..., 3, 3) [-] to (..., 3) [-]."""
    part = (matrix - np.swapaxes(matrix, -1, -2)) / 2
    return np.stack([part[..., 2, 1], part[..., 0, 2], part[..., 1, 0]], axis=-1)


def rotation(axis: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    """Rotation e^{[w] theta} (..., 3, 3) about unit axes (..., 3) by angles (...) [rad], Rodrigues' formula."""
    w, theta = hat(axis), np.asarray(angle)[..., None, None]
    return np.eye(3) + np.sin(theta) * w + (1 - np.cos(theta)) * (w @ w)


def turned_by(vector: np.ndarray) -> np.ndarray:
    """Rotation e^{[v]} (..., 3, 3) of rotation vectors (..., 3) [rad]."""
    return Rotation.from_rotvec(np.reshape(vector, (-1, 3))).as_matrix().reshape(*np.shape(vector), 3)


def motion(matrix: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Rigid motion [R p; 0 1] (..., 4, 4) of rotations (..., 3, 3) and shifts (..., 3) [m]."""
    pose = np.zeros((*np.shape(matrix)[:-2], 4, 4))
    pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = matrix, shift, 1
    return pose


def inverse(pose: np.ndarray) -> np.ndarray:
    """Inverse [R^T, -R^T p; 0 1] of poses (..., 4, 4) (Eq. 6)."""
    turned = np.swapaxes(pose[..., :3, :3], -1, -2)
    return motion(turned, -np.einsum("...ij,...j->...i", turned, pose[..., :3, 3]))


def apply(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (..., k, 3) [m] carried by poses (..., 4, 4): X_M = T_MF X_F (Eq. 4)."""
    return points @ np.swapaxes(pose[..., :3, :3], -1, -2) + pose[..., None, :3, 3]
