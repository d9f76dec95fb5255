"""Joint axis whose centre moves with the angle, as in a rolling contact (paper Table 1: X = G theta + Y).

    e^{[S(theta)] theta},  S(theta) = (w, -w x Q(theta)),  Q(theta) = Y + G theta
    R = e^{[w] theta},     p = (I - R) Q(theta)

Q is the centre of the finite rotation from the reference posture. With G = 0 the axis is an ordinary screw. The spatial
velocity per rad, (w, -w x Q + (I - R) G), replaces the constant screw in the space Jacobian (Eq. 17).
"""

from dataclasses import dataclass

import numpy as np

from exodrake.identification.kinematics.screws import motion, rotation


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

    def velocity(self, angle: np.ndarray) -> np.ndarray:
        """Column of the space Jacobian (..., 6), the spatial velocity per rad, at angles (...) [rad]."""
        slide = self.slope - rotation(self.direction, angle) @ self.slope
        v = np.cross(self.centre(angle), self.direction) + slide
        return np.concatenate([np.broadcast_to(self.direction, v.shape), v], axis=-1)


def across(vector: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Component of vectors (..., 3) [m] normal to a unit direction (3,) [-]: the observable part of a centre."""
    return vector - np.asarray(vector @ direction)[..., None] * direction


def joint_length(near: Axis, far: Axis, origin: np.ndarray) -> float:
    """Distance [m] between two joint axes, in a plane through `origin` (3,) [m] normal to their mean direction.

    The position of a centre along its axis cannot be observed, so the plane through the markers of the segment serves
    as the middle of the finger.
    """
    a, b, _ = joint_points(near, far, origin)
    return float(np.linalg.norm(b - a))


def joint_points(near: Axis, far: Axis, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (3,) [m] where two axes cross the plane of `joint_length`, and the unit normal (3,) of that plane."""
    normal = near.direction + far.direction
    normal = normal / np.linalg.norm(normal)
    a, b = (
        axis.point + axis.direction * ((origin - axis.point) @ normal) / (axis.direction @ normal)
        for axis in (near, far)
    )
    return a, b, normal
