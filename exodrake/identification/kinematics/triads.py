"""Pose of a segment from its three markers.

The sides of a triad are the medians of the marker distances over all frames, which neither the motion of the hand nor a
few swapped frames disturb. Its frame has the origin in the centroid, x from the first marker to the second, and z
normal to the triangle (first to second to third, right-handed). The pose in each frame of the recording is the
least-squares fit of that shape to the measured markers (Kabsch).
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from exodrake.core.errors import InputError
from exodrake.identification.kinematics.rigid import motion

FLATTEST = 2e-3  # m; a lower triangle does not determine the rotation about its long side


@dataclass(frozen=True)
class Triad:
    """Three markers on one segment: names, and positions `shape` (3, 3) [m] in the frame of the segment."""

    names: tuple[str, str, str]
    shape: np.ndarray

    @property
    def sides(self) -> np.ndarray:
        """Distances 1-2, 2-3, 3-1 (3,) [m]."""
        return np.linalg.norm(self.shape - np.roll(self.shape, -1, axis=0), axis=1)


@dataclass(frozen=True)
class SegmentMotion:
    """Motion of a segment, NaN where a marker is missing.

    Attributes:
        triad: The markers.
        pose: (frames, 4, 4) from the frame of the segment to that of the laboratory [m].
        residual: (frames,) RMS distance between measured and fitted markers [m].
    """

    triad: Triad
    pose: np.ndarray
    residual: np.ndarray


def triad_of(points: np.ndarray, names: tuple[str, str, str], source: str = "recording") -> Triad:
    """Estimate the shape of a triad from markers (frames, 3, 3) [m] with NaN. InputError if collinear."""
    whole = points[np.isfinite(points).all(axis=(1, 2))]
    if not len(whole):
        raise InputError(f"{source}: markers {', '.join(names)} are never seen together")
    side = np.median(np.linalg.norm(whole - np.roll(whole, -1, axis=1), axis=2), axis=0)
    base, right, left = side
    along = (base**2 + left**2 - right**2) / (2 * base) if base > 0 else 0.0
    height = np.sqrt(max(left**2 - along**2, 0.0))
    altitude = base * height / max(side)
    if altitude < FLATTEST:
        low = 1e3 * altitude
        raise InputError(
            f"{source}: markers {', '.join(names)} lie on a line (height {low:.2f} mm), which determines no frame"
        )
    return Triad(names, corners() @ np.array([base, along, height]))


def corners() -> np.ndarray:
    """Derivatives (3, 3, 3) [-] of the markers of a triad in its own frame for the sides (base, along, height) [m]."""
    place = np.zeros((3, 3, 3))
    place[1, 0, 0] = place[2, 0, 1] = place[2, 1, 2] = 1
    return place - place.mean(axis=0)


def place(triad: Triad, points: np.ndarray) -> SegmentMotion:
    """Fit the pose of a triad to markers (frames, 3, 3) [m] in every frame by least squares (Kabsch)."""
    return SegmentMotion(triad, *placed(triad.shape, points))


def placed(shape: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses (frames, 4, 4) [m] and residuals (frames,) [m] of `kabsch`, NaN where one of points is missing."""
    whole = np.isfinite(points).all(axis=(1, 2))
    pose, residual = np.full((len(points), 4, 4), np.nan), np.full(len(points), np.nan)
    if whole.any():
        pose[whole], residual[whole] = kabsch(shape, points[whole])
    return pose, residual


def kabsch(shape: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit rigid motions of a shape to points by least squares (Kabsch).

    Args:
        shape: (k, 3) points of the body [m].
        points: (frames, k, 3) measured points [m].

    Returns:
        Poses (frames, 4, 4) [m] and RMS residuals (frames,) [m].
    """
    middle, centre = shape.mean(axis=0), points.mean(axis=1)
    moved, wanted = shape - middle, points - centre[:, None, :]
    u, _, vt = np.linalg.svd(np.einsum("ki,fkj->fij", moved, wanted))
    sign = np.linalg.det(u @ vt)
    u[:, :, 2] *= sign[:, None]
    turn = np.swapaxes(u @ vt, 1, 2)
    left = wanted - moved @ np.swapaxes(turn, 1, 2)
    return motion(turn, centre - turn @ middle), np.sqrt(np.mean(np.sum(left**2, axis=2), axis=1))


def triad_pose(points: np.ndarray) -> np.ndarray:
    """Pose (4, 4) of a triad from exact markers (3, 3) [m]: centroid, x from first to second, z normal."""
    x = points[1] - points[0]
    z = np.cross(x, points[2] - points[0])
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return motion(np.stack([x, np.cross(z, x), z], axis=1), points.mean(axis=0))


def mean_pose(poses: np.ndarray) -> np.ndarray:
    """Mean (4, 4) of poses (frames, 4, 4) [m] that lie close together and hold no NaN."""
    return motion(Rotation.from_matrix(poses[:, :3, :3]).mean().as_matrix(), poses[:, :3, 3].mean(axis=0))
