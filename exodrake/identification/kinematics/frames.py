"""Rigid frames from three markers per segment, and what makes a triad unfit for one.

The shape of a triad is taken from the recording itself: its three sides are the medians of the marker distances over
all frames, which neither the hand's motion nor a few swapped frames disturb. Its frame has the origin in the centroid,
x from the first marker to the second, z normal to the triangle (first to second to third, right-handed). Every frame
of the recording is then the least-squares placement of that shape on the measured markers (Kabsch); the distance left
over is its quality.
"""

from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError
from exodrake.identification.kinematics.screws import motion

FLATTEST = 2e-3  # m; a triangle lower than this does not fix the turn about its long side


@dataclass(frozen=True)
class Triad:
    """Three markers on one segment: their names and their places in the segment's own frame, shape (3, 3) [m]."""

    names: tuple[str, str, str]
    shape: np.ndarray

    @property
    def sides(self) -> np.ndarray:
        """Distances 1-2, 2-3, 3-1 [m]."""
        return np.linalg.norm(self.shape - np.roll(self.shape, -1, axis=0), axis=1)


@dataclass(frozen=True)
class SegmentMotion:
    """Where a segment was: pose (frames, 4, 4), from the segment's frame to the laboratory's, and residual (frames,),
    the RMS distance [m] between measured markers and the placed triad. Both NaN where a marker is missing."""

    triad: Triad
    pose: np.ndarray
    residual: np.ndarray


def triad_of(points: np.ndarray, names: tuple[str, str, str], source: str = "recording") -> Triad:
    """The triad's shape from its markers. points (frames, 3, 3) [m], NaN where missing. InputError for a collinear
    triad."""
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
            f"{source}: markers {', '.join(names)} lie on a line (triangle {low:.2f} mm high), which fixes no frame"
        )
    corners = np.array([[0.0, 0.0, 0.0], [base, 0.0, 0.0], [along, height, 0.0]])
    return Triad(names, corners - corners.mean(axis=0))


def place(triad: Triad, points: np.ndarray) -> SegmentMotion:
    """Least-squares placement of the triad in every frame (Kabsch). points (frames, 3, 3) [m]."""
    whole = np.isfinite(points).all(axis=(1, 2))
    pose, residual = np.full((len(points), 4, 4), np.nan), np.full(len(points), np.nan)
    if whole.any():
        pose[whole], residual[whole] = kabsch(triad.shape, points[whole])
    return SegmentMotion(triad, pose, residual)


def kabsch(shape: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rigid motion that carries shape (k, 3) closest to points (frames, k, 3), and the RMS distance left [m]
    (frames,)."""
    middle, centre = shape.mean(axis=0), points.mean(axis=1)
    moved, wanted = shape - middle, points - centre[:, None, :]
    u, _, vt = np.linalg.svd(np.einsum("ki,fkj->fij", moved, wanted))
    sign = np.linalg.det(u @ vt)
    u[:, :, 2] *= sign[:, None]
    turn = np.swapaxes(u @ vt, 1, 2)
    left = wanted - moved @ np.swapaxes(turn, 1, 2)
    return motion(turn, centre - turn @ middle), np.sqrt(np.mean(np.sum(left**2, axis=2), axis=1))


def mean_pose(poses: np.ndarray) -> np.ndarray:
    """Mean of poses close together: mean place, mean rotation brought back to a rotation. poses (frames, 4, 4) without
    NaN."""
    u, _, vt = np.linalg.svd(poses[:, :3, :3].mean(axis=0))
    return motion(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt, poses[:, :3, 3].mean(axis=0))
