"""Rigid motions, the axis of a joint, and axis, angle and centre of a one-axis joint from its motion.

Rotations R (3, 3) and motions T = [R p; 0 1] (4, 4) act on the leading axes (`...`), which are frames of a recording.

The centre of an axis moves with the angle, as in a rolling contact (paper Table 1: X = G theta + Y):

    e^{[S(theta)] theta},  S(theta) = (w, -w x Q(theta)),  Q(theta) = Y + G theta
    R = e^{[w] theta},     p = (I - R) Q(theta)

Q is the centre of the finite rotation from the reference posture. With G = 0 the axis is an ordinary screw.

A finger joint has a constant axis, so it is estimated once from all frames, which removes its noise from every centre.
With the axis known, w x G^{-1} p of Eq. 8-12 has the closed form

    Q = 1/2 p + 1/2 cot(theta/2) w x p                p normal to w

with an error that grows as 1/theta. Frames therefore have the weight (2 sin(theta/2))^2, about theta^2, in all sums.
"""

from collections.abc import Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True)
class Axis:
    """Joint axis in the frame of the segment proximal to the joint.

    Attributes:
        direction: Unit direction w (3,).
        point: Centre Y (3,) [m] at angle 0.
        slope: Slope G (3,) [m/rad] of the centre.
    """

    direction: np.ndarray
    point: np.ndarray
    slope: np.ndarray

    def centre(self, angle: np.ndarray) -> np.ndarray:
        """Centre Q(theta) (..., 3) [m] at angles (...) [rad]."""
        return self.point + self.slope * np.asarray(angle)[..., None]

    def pose(self, angle: np.ndarray) -> np.ndarray:
        """Motion from the reference posture (..., 4, 4) at angles (...) [rad]."""
        turn = rotation(self.direction, angle)
        centre = self.centre(angle)
        return motion(turn, centre - np.einsum("...ij,...j->...i", turn, centre))

    def seen_from(self, pose: np.ndarray) -> "Axis":
        """The axis in the frame of a pose (4, 4) [m], centre and slope normal to it."""
        into = inverse(pose)
        turn = into[:3, :3]
        w = turn @ self.direction
        return Axis(w, across(apply(into, self.point[None])[0], w), across(turn @ self.slope, w))


def chain_pose(axes: Sequence[Axis], angles: np.ndarray) -> np.ndarray:
    """Product (frames, 4, 4) of the motions of the axes at angles (frames, axes) [rad] (Eq. 14 without M)."""
    pose = axes[0].pose(angles[:, 0])
    for number, axis in enumerate(axes[1:], start=1):
        pose = pose @ axis.pose(angles[:, number])
    return pose


def across(vector: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Component of vectors (..., 3) [m] normal to a unit direction (3,) [-]: the observable part of a centre."""
    return vector - np.asarray(vector @ direction)[..., None] * direction


def joint_points(near: Axis, far: Axis, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (3,) [m] where axes cross the plane through `origin` (3,) [m] normal to their mean; that normal (3,)."""
    normal = near.direction + far.direction
    normal = normal / np.linalg.norm(normal)
    a, b = (
        axis.point + axis.direction * ((origin - axis.point) @ normal) / (axis.direction @ normal)
        for axis in (near, far)
    )
    return a, b, normal


def mean_axis(turns: np.ndarray) -> np.ndarray:
    """Estimate the unit direction (3,) [-] of the common axis of rotations (frames, 3, 3) from the reference posture.

    It is the principal direction of w sin theta, so small angles have little weight; positive towards the larger
    excursion (flexion).
    """
    sines = vee(turns)
    _, vectors = np.linalg.eigh(sines.T @ sines)
    axis = vectors[:, -1]
    along = sines @ axis
    return axis if np.sum(along * np.abs(along)) >= 0 else -axis


def angle_about(turns: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Signed angle (frames,) [rad] about an axis (3,) nearest to each rotation (frames, 3, 3).

    tan theta = (w . vee(R - R^T) / 2) / ((tr R - w^T R w) / 2), exact for a rotation about w and unbiased near zero.
    """
    about = np.einsum("i,fij,j->f", axis, turns, axis)
    return np.arctan2(vee(turns) @ axis, (np.trace(turns, axis1=1, axis2=2) - about) / 2)


def centres(turns: np.ndarray, axis: np.ndarray, angle: np.ndarray, about: np.ndarray) -> np.ndarray:
    """Joint centre normal to the axis in every frame.

    Args:
        turns: (frames, 4, 4) motions from the reference posture [m].
        axis: (3,) unit direction.
        angle: (frames,) angle about the axis [rad].
        about: (3,) point near the joint and the markers [m]; residual rotations about other axes act on the lever from
            this point instead of from a distant origin.

    Returns:
        Centres (frames, 3) [m], NaN at angle 0.
    """
    moved = turns[:, :3, :3] @ about + turns[:, :3, 3] - about
    moved = across(moved, axis)
    with np.errstate(divide="ignore", invalid="ignore"):
        quarter = np.cross(axis, moved) / np.tan(angle / 2)[:, None]
    found = across(about, axis) + (moved + quarter) / 2
    found[angle == 0] = np.nan
    return found


def weight(angle: np.ndarray) -> np.ndarray:
    """Weight (2 sin(theta/2))^2 (frames,) [-] of centres at angles (frames,) [rad]: their inverse relative variance."""
    return (2 * np.sin(angle / 2)) ** 2
