"""Rigid motions: axis, angle and centre of a one-axis joint, and the pose of a segment from its three markers.

Rotations R (3, 3) and motions T = [R p; 0 1] (4, 4) act on the leading axes (`...`), which are frames of a recording.

The centre of an axis moves with the angle, as in a rolling contact (paper Table 1: X = G theta + Y):

    e^{[S(theta)] theta},  S(theta) = (w, -w x Q(theta)),  Q(theta) = Y + G theta
    R = e^{[w] theta},     p = (I - R) Q(theta)

Q is the centre of the finite rotation from the reference posture. With G = 0 the axis is an ordinary screw.

A finger joint has a constant axis, so it is estimated once from all frames, which removes its noise from every centre.
With the axis known, w x G^{-1} p of Eq. 8-12 has the closed form

    Q = 1/2 p + 1/2 cot(theta/2) w x p                p normal to w

with an error that grows as 1/theta. Frames therefore have the weight (2 sin(theta/2))^2, about theta^2, in all sums.

The sides of a triad are the medians of the marker distances over all frames, which neither the motion of the hand nor a
few swapped frames disturb. Its frame has the origin in the centroid, x from the first marker to the second, and z
normal to the triangle (first to second to third, right-handed). The pose in each frame of the recording is the
least-squares fit of that shape to the measured markers (Kabsch).

A triad is rigid, so a wrong label shows as a jump of the residual, in both triads if the swap is between segments. A
frame counts as swapped if the exchange of one pair restores the shape of every triad. Triads should have three
different sides: a swap within an isosceles triad cannot be detected.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from exodrake.core.errors import InputError
from exodrake.identification.kinematics.markers import SEGMENTS, Layout, Recording


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


PAIRS = tuple(combinations(range(12), 2))  # of markers that may carry each other's name
OUTLIER = 4.0  # times the median residual
EXACT = 3e-4  # m; residual below which no frame is suspected, however small the median
SUSPECT = 1.2e-3  # m; a triad that changes its shape by this much in a tenth of the frames may hold a wrong marker
LOOSE = 4e-3  # m; one that changes it by this much is no rigid body


@dataclass(frozen=True)
class Swap:
    """Two markers that carry each other's name from `first` through `last` (frames)."""

    names: tuple[str, str]
    first: int
    last: int


@dataclass(frozen=True)
class LabelCheck:
    """Result of `check_labels`: triads, swaps, unusable frames `spoilt` (4, frames), and remarks for the report."""

    triads: tuple[Triad, ...]
    swaps: tuple[Swap, ...]
    spoilt: np.ndarray
    remarks: tuple[str, ...]


def check_labels(recording: Recording, layout: Layout) -> LabelCheck:
    """Compare every frame with the shapes of the triads. InputError for missing markers, collinear or loose triads."""
    points = recording.of(layout.finger)
    triads = _triads(points, layout, recording.source)
    residual = _residuals(triads, points)
    median = np.nanmedian(residual, axis=1)
    _refuse_loose(recording, layout, points, np.nanquantile(residual, 0.9, axis=1))
    limit = np.maximum(OUTLIER * median, EXACT)[:, None]
    bad = residual > limit
    suspects = np.flatnonzero(bad.any(axis=0))
    pairs = np.full(len(points), -1)
    pairs[suspects] = _exchanges(triads, points[suspects], bad[:, suspects], limit)
    for pair in np.unique(pairs[pairs >= 0]):
        pairs = _extended(triads, points, residual, pairs, int(pair))
    spoilt = bad & (pairs < 0)
    swaps = _runs(np.flatnonzero(pairs >= 0), pairs[pairs >= 0], layout.finger)
    return LabelCheck(triads, swaps, spoilt, _remarks(triads, median, spoilt))


def refuse_swaps(check: LabelCheck, recording: Recording) -> None:
    """Raise InputError naming the markers and the first frame, if any are swapped."""
    if check.swaps:
        swap = check.swaps[0]
        frames = sum(s.last - s.first + 1 for s in check.swaps)
        a, b = swap.names
        raise InputError(
            f"{recording.source}: markers {a} and {b} are swapped from frame {swap.first}"
            f" ({recording.time[swap.first]:.3f} s) to {swap.last}"
            f" ({frames} swapped frames in all); correct the labels, or let --repair exchange them"
        )


def relabelled(recording: Recording, swaps: tuple[Swap, ...]) -> Recording:
    """Exchange the swapped markers of a recording."""
    positions = recording.positions.copy()
    for swap in swaps:
        a, b = (recording.names.index(name) for name in swap.names)
        span = slice(swap.first, swap.last + 1)
        positions[span, a], positions[span, b] = recording.positions[span, b], recording.positions[span, a]
    return replace(recording, positions=positions)


def _residuals(triads: tuple[Triad, ...], points: np.ndarray) -> np.ndarray:
    """RMS residual (4, frames) [m] of points (frames, 12, 3) [m], NaN where a marker is missing."""
    return np.stack([placed(triad.shape, points[:, 3 * k : 3 * k + 3])[1] for k, triad in enumerate(triads)])


def _triads(points: np.ndarray, layout: Layout, source: str) -> tuple[Triad, ...]:
    """Shapes of the four triads from points (frames, 12, 3) [m]. InputError for a collinear one."""
    return tuple(triad_of(points[:, 3 * k : 3 * k + 3], names, source) for k, names in enumerate(layout.segments))


def _exchanged(points: np.ndarray, pair: tuple[int, int]) -> np.ndarray:
    """Points (frames, 12, 3) [m] with a pair of markers exchanged."""
    swapped = points.copy()
    swapped[:, pair] = points[:, pair[::-1]]
    return swapped


def _exchanges(triads: tuple[Triad, ...], points: np.ndarray, bad: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Find in each suspect frame the pair whose exchange gives the smallest residual, or -1."""
    best, answer = np.full(len(points), np.inf), np.full(len(points), -1)
    if not len(points):
        return answer
    for number, (a, b) in enumerate(PAIRS):
        if not bad[[a // 3, b // 3]].any():
            continue
        residual = np.nan_to_num(_residuals(triads, _exchanged(points, (a, b))) / limit)
        touched = bad[a // 3] | bad[b // 3]
        worst = np.where(touched, residual.max(axis=0), np.inf)
        better = (worst < 1 / 2) & (worst < best)
        best[better], answer[better] = worst[better], number
    return answer


def _extended(
    triads: tuple[Triad, ...], points: np.ndarray, residual: np.ndarray, pairs: np.ndarray, pair: int
) -> np.ndarray:
    """Extend a swap to neighbouring frames whose residual is smaller with the exchange: noise hides single frames."""
    swapped = _residuals(triads, _exchanged(points, PAIRS[pair]))
    better = np.nansum(swapped, axis=0) < np.nansum(residual, axis=0)
    better |= pairs == pair
    bounds = np.flatnonzero(np.diff(np.r_[False, better, False]))
    for first, stop in bounds.reshape(-1, 2):
        if np.mean(pairs[first:stop] == pair) > 1 / 4:
            pairs[first:stop] = pair
    return pairs


def _runs(frames: np.ndarray, pairs: np.ndarray, names: tuple[str, ...]) -> tuple[Swap, ...]:
    """Join consecutive frames with the same exchange into swaps."""
    swaps: list[Swap] = []
    for frame, pair in zip(frames.tolist(), pairs.tolist(), strict=True):
        a, b = (names[marker] for marker in PAIRS[pair])
        if swaps and swaps[-1].names == (a, b) and swaps[-1].last == frame - 1:
            swaps[-1] = replace(swaps[-1], last=frame)
        else:
            swaps.append(Swap((a, b), frame, frame))
    return tuple(swaps)


def _refuse_loose(recording: Recording, layout: Layout, points: np.ndarray, residual: np.ndarray) -> None:
    """InputError if a triad is not rigid; `residual` (4,) [m] is exceeded in a tenth of the frames."""
    k = int(np.argmax(residual))
    if residual[k] < SUSPECT:
        return
    names = f"markers {', '.join(layout.segments[k])} ({SEGMENTS[k]})"
    change = f"by {1e3 * residual[k]:.1f} mm or more in a tenth of the frames"
    loose = f"{recording.source}: {names} change their shape, {change}"
    some = points[:: max(1, len(points) // 200)]
    for a, b in PAIRS:
        if a // 3 == b // 3 or k not in (a // 3, b // 3):
            continue
        if _worst_change(_exchanged(some, (a, b)), layout) < residual[k] / 2:
            raise InputError(
                f"{loose}; with {layout.finger[a]} and {layout.finger[b]} exchanged they do not: look at these labels"
            )
    if residual[k] > LOOSE:
        raise InputError(loose)


def _worst_change(points: np.ndarray, layout: Layout) -> float:
    """Residual that the worst triad exceeds in a tenth of the frames [m]; infinite for a collinear triad."""
    try:
        triads = _triads(points, layout, "recording")
    except InputError:
        return np.inf
    return float(np.nanquantile(_residuals(triads, points), 0.9, axis=1).max())


def _remarks(triads: tuple[Triad, ...], median: np.ndarray, spoilt: np.ndarray) -> tuple[str, ...]:
    remarks = []
    for k, triad in enumerate(triads):
        sides = np.sort(triad.sides)
        if np.diff(sides).min() < 2 * max(OUTLIER * median[k], EXACT):
            near = 1e3 * np.diff(sides).min()
            remarks.append(f"{SEGMENTS[k]} triad: two sides differ by {near:.1f} mm only, some swaps would not be seen")
        if spoilt[k].any():
            count = np.count_nonzero(spoilt[k])
            remarks.append(f"{SEGMENTS[k]} triad: {count} frames left out: wrong shape that no exchange corrects")
    return tuple(remarks)
