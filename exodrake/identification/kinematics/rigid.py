"""Rigid motions: moving joint axes, the screws of the paper (Eq. 4-16), and poses of marker triads.

Rotations R (3, 3) and motions T = [R p; 0 1] (4, 4) act on the leading axes (`...`), frames of a recording. An axis w
has the centre Q(theta) = Y + G theta: R = e^{[w] theta}, p = (I - R) Q; more in `docs/explain/identification.md`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from scipy.spatial.transform import Rotation


def hat(w: np.ndarray) -> np.ndarray:
    """Matrix [w] of the cross product w x (Eq. 11): (..., 3) [-] to (..., 3, 3) [-]."""
    return np.cross(np.eye(3), np.asarray(w)[..., None, :])


def motion(matrix: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Rigid motion [R p; 0 1] (..., 4, 4) of rotations (..., 3, 3) and shifts (..., 3) [m]."""
    pose = np.zeros((*np.shape(matrix)[:-2], 4, 4))
    pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = matrix, shift, 1
    return pose


def inverse(pose: np.ndarray) -> np.ndarray:
    """Inverse [R^T, -R^T p; 0 1] of poses (..., 4, 4) [m] (Eq. 6), NaN where they are."""
    turned = np.swapaxes(pose[..., :3, :3], -1, -2)
    return motion(turned, -np.einsum("...ij,...j->...i", turned, pose[..., :3, 3]))


def apply(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (..., k, 3) [m] carried by poses (..., 4, 4): X_M = T_MF X_F (Eq. 4)."""
    return points @ np.swapaxes(pose[..., :3, :3], -1, -2) + pose[..., None, :3, 3]


def across(vector: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Component of vectors (..., 3) [m] normal to a unit direction (3,) [-]: the observable part of a centre."""
    return vector - np.asarray(vector @ direction)[..., None] * direction


@dataclass(frozen=True)
class Axis:
    """Joint axis in the frame of the proximal segment: direction w (3,), centre Y (3,) [m] and slope G (3,) [m/rad]."""

    direction: np.ndarray
    point: np.ndarray
    slope: np.ndarray

    def centre(self, angle: np.ndarray) -> np.ndarray:
        """Centre Q(theta) (..., 3) [m] at angles (...) [rad]."""
        return self.point + self.slope * np.asarray(angle)[..., None]

    def turn(self, angle: np.ndarray) -> np.ndarray:
        """Rotation (..., 3, 3) by angles (...,) [rad]."""
        return Rotation.from_rotvec(self.direction * np.asarray(angle)[..., None]).as_matrix()

    def pose(self, angle: np.ndarray) -> np.ndarray:
        """Motion from the reference posture (..., 4, 4) at angles (...) [rad]."""
        turn, centre = self.turn(angle), self.centre(angle)
        return motion(turn, centre - np.einsum("...ij,...j->...i", turn, centre))

    def velocity(self, angle: np.ndarray) -> np.ndarray:
        """Spatial velocity (w, -w x Q + (I - R) G) per rad (..., 6) [-, m/rad] at angles (...) [rad]."""
        v = np.cross(self.centre(angle), self.direction) + self.slope - self.turn(angle) @ self.slope
        return np.concatenate([np.broadcast_to(self.direction, v.shape), v], axis=-1)

    def express_in(self, pose: np.ndarray) -> Axis:
        """The axis in the frame of a pose (4, 4) [m], centre and slope normal to it."""
        into = inverse(pose)
        w = into[:3, :3] @ self.direction
        return Axis(w, across(apply(into, self.point[None])[0], w), across(into[:3, :3] @ self.slope, w))


def chain_poses(axes: Sequence[Axis], angles: np.ndarray) -> list[np.ndarray]:
    """Poses (frames, 4, 4) before the first axis and after each, at angles (frames, axes) [rad] (Eq. 14 without M)."""
    motions = (axis.pose(angles[:, number]) for number, axis in enumerate(axes))
    return list(accumulate(motions, np.matmul, initial=np.broadcast_to(np.eye(4), (len(angles), 4, 4))))


def space_jacobian(axes: Sequence[Axis], angles: np.ndarray) -> np.ndarray:
    """Spatial velocity (frames, 6, axes) [-, m/rad] of each axis at angles (frames, axes) [rad] (Eq. 16)."""
    columns = []
    for number, (axis, pose) in enumerate(zip(axes, chain_poses(axes, angles))):
        w, v = np.split(axis.velocity(angles[:, number]), 2, axis=-1)
        w, v = (np.einsum("fij,fj->fi", pose[:, :3, :3], part) for part in (w, v))
        columns.append(np.concatenate([w, v + np.cross(pose[:, :3, 3], w)], axis=1))
    return np.stack(columns, axis=2)


def centres(turns: np.ndarray, axis: np.ndarray, angle: np.ndarray, about: np.ndarray) -> np.ndarray:
    """Joint centres (frames, 3) [m] normal to the axis in every frame, NaN at angle 0.

    From motions (frames, 4, 4) from the reference posture [m], the unit direction of the axis (3,), and the angle about
    it (frames,) [rad]. Residual rotations about other axes act on the lever from a point `about` (3,) [m] near the
    joint and the markers, instead of from a distant origin.
    """
    shift = across(turns[:, :3, :3] @ about + turns[:, :3, 3] - about, axis)
    with np.errstate(divide="ignore", invalid="ignore"):
        quarter = np.cross(axis, shift) / np.tan(angle / 2)[:, None]
    found = across(about, axis) + (shift + quarter) / 2
    found[angle == 0] = np.nan
    return found


def corners() -> np.ndarray:
    """Derivatives (3, 3, 3) [-] of the markers of a triad in its own frame for the sides (base, along, height) [m]."""
    place = np.zeros((3, 3, 3))
    place[1, 0, 0] = place[2, 0, 1] = place[2, 1, 2] = 1
    return place - place.mean(axis=0)


def fit_pose(shape: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses (frames, 4, 4) [m] that carry a shape (k, 3) [m] to points (frames, k, 3) [m] by least squares (Kabsch).

    With RMS residuals (frames,) [m]; both are NaN in frames where a point is missing.
    """
    whole = np.isfinite(points).all(axis=(1, 2))
    pose, residual = np.full((len(points), 4, 4), np.nan), np.full(len(points), np.nan)
    if not whole.any():
        return pose, residual
    middle, centre = shape.mean(axis=0), points[whole].mean(axis=1)
    own, wanted = shape - middle, points[whole] - centre[:, None, :]
    u, _, vt = np.linalg.svd(np.einsum("ki,fkj->fij", own, wanted))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    turn = np.swapaxes(u @ vt, 1, 2)
    left = wanted - own @ np.swapaxes(turn, 1, 2)
    pose[whole] = motion(turn, centre - turn @ middle)
    residual[whole] = np.sqrt(np.mean(np.sum(left**2, axis=2), axis=1))
    return pose, residual


def triad_pose(points: np.ndarray) -> np.ndarray:
    """Pose (4, 4) of a triad from exact markers (3, 3) [m]: centroid, x from first to second, z normal."""
    x = points[1] - points[0]
    z = np.cross(x, points[2] - points[0])
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return motion(np.stack([x, np.cross(z, x), z], axis=1), points.mean(axis=0))
