"""Joint axis whose centre moves with the angle, as in a rolling contact (paper Table 1: X = G theta + Y).

    e^{[S(theta)] theta},  S(theta) = (w, -w x Q(theta)),  Q(theta) = Y + G theta
    R = e^{[w] theta},     p = (I - R) Q(theta)

Q is the centre of the finite rotation from the reference posture. With G = 0 the axis is an ordinary screw.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from exodrake.identification.kinematics.rigid import apply, inverse, motion, rotation


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
