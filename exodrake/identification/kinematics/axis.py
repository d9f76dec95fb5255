"""A joint axis whose centre moves with the angle, as a rolling contact does (paper Table 1: X = G theta + Y).

    e^{[S(theta)] theta},  S(theta) = (w, -w x Q(theta)),  Q(theta) = Y + G theta        so R = e^{[w] theta}, p = (I -
    R) Q(theta)

Q is the centre of the finite turn from the reference posture. With G = 0 this is an ordinary screw. Its spatial
velocity per rad is (w, -w x Q + (I - R) G), which takes the place of the constant screw in the space Jacobian (Eq. 17).
"""

from dataclasses import dataclass

import numpy as np

from exodrake.identification.kinematics.screws import motion, rotation


@dataclass(frozen=True)
class Axis:
    """Unit direction w (3,), point Y (3,) [m] at angle 0 and slope G (3,) [m/rad] of the centre, in the frame proximal
    to the joint."""

    direction: np.ndarray
    point: np.ndarray
    slope: np.ndarray

    def centre(self, angle: np.ndarray) -> np.ndarray:
        """Q(theta) (..., 3) [m]; angle (...) [rad]."""
        return self.point + self.slope * np.asarray(angle)[..., None]

    def pose(self, angle: np.ndarray) -> np.ndarray:
        """The turn from the reference posture (..., 4, 4); angle (...) [rad]."""
        turn = rotation(self.direction, angle)
        centre = self.centre(angle)
        return motion(turn, centre - np.einsum("...ij,...j->...i", turn, centre))

    def velocity(self, angle: np.ndarray) -> np.ndarray:
        """Spatial velocity per rad (..., 6), the column of the space Jacobian; angle (...) [rad]."""
        slide = self.slope - rotation(self.direction, angle) @ self.slope
        v = np.cross(self.centre(angle), self.direction) + slide
        return np.concatenate([np.broadcast_to(self.direction, v.shape), v], axis=-1)


def across(vector: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The part of a vector across a unit direction, the only part of a centre that can be observed. (..., 3) and
    (3,)."""
    return vector - np.asarray(vector @ direction)[..., None] * direction


def joint_length(near: Axis, far: Axis, origin: np.ndarray) -> float:
    """Distance [m] between two joint axes given in one frame, where they cross the plane through `origin` across their
    mean direction.

    A centre's place along its axis cannot be observed, so the plane through the segment's markers stands for the
    finger's middle.
    """
    a, b, _ = joint_points(near, far, origin)
    return float(np.linalg.norm(b - a))


def joint_points(near: Axis, far: Axis, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the two axes cross the plane of `joint_length`, and the plane's unit normal; three (3,) arrays."""
    normal = near.direction + far.direction
    normal = normal / np.linalg.norm(normal)
    a, b = (
        axis.point + axis.direction * ((origin - axis.point) @ normal) / (axis.direction @ normal)
        for axis in (near, far)
    )
    return a, b, normal
