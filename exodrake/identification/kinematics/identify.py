"""Kinematic identification of the paper's 2.2.1: markers to joint axes, centres, angles, lengths and ranges.

Bundle adjustment of finger, hand poses and angles to all markers, after a first guess from hinges; the equations are in
`docs/explain/identification.md`. Joint i is described in the frame of the triad proximal to it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import whittaker_henderson
from scipy.spatial.transform import Rotation

from exodrake.core.confidence import NORMAL_95
from exodrake.core.errors import InputError
from exodrake.identification.kinematics import rigid
from exodrake.identification.kinematics.markers import JOINTS, SEGMENTS, Layout, Recording, check_labels

TRIAD = 3
COUNT = 3 * TRIAD * len(SEGMENTS)  # coordinates of markers
PER_AXIS = 9  # small rotation of w, Y, G
ALL = COUNT + PER_AXIS * 4
LOCAL = 10  # of a frame: rotation and shift of the hand, four angles
FREE = 51  # changes of a finger that markers can show
STEPS = 60  # a finger needs 5 to 15
CONVERGED = 1e-10  # relative decrease of the cost
ROUNDING = 1e-14  # m; errors as small are rounding
FRAME_STEPS, STILL = 20, 1e-12  # of a frame with the finger known; last step [rad, m]
CARRIES = np.repeat(np.tri(len(SEGMENTS), dtype=bool) & (np.arange(4) > 0)[:, None], TRIAD, axis=0)  # (12, 4) by joint
HELD = 1e-9  # m2; holds what missing markers leave open in a frame
PRIOR = np.r_[np.full(COUNT, 0.03), np.tile(np.repeat([0.5, 0.03, 0.03], 3), 4)] ** -2  # m, rad, m/rad; assumed, wide
FEWEST = 50  # frames in which a joint must be seen
UNSTEADY = 0.12  # rad RMS about the mean posture of the rest
ORDER = 3  # of the differences that the smoothing spline penalises
NUDGE = 1e-6  # m, rad, m/rad; of the difference quotient
FRAMES = 4000  # of the adjustment, equispaced beside the rest: they cover minutes of recording
CUTOFF = 4.0  # Hz, of the smoothing
LONGEST_GAP = 0.2  # s, longest gap that is filled
REST = 1.0  # s, duration of the rest at the start
SMALLEST_ANGLE = 0.3  # rad, whose centres are shown and measured against their line
BLOCK = 1.0  # s, time within which errors may be correlated


@dataclass(frozen=True)
class Finger:
    """Finger at rest in the frame of the base triad: markers (4, 3, 3) [m] by segment; abduction and flexion axes."""

    markers: np.ndarray
    axes: tuple[rigid.Axis, rigid.Axis, rigid.Axis, rigid.Axis]

    def free(self) -> np.ndarray:
        """Changes that markers can show, as columns (72, 51) [m, rad, m/rad] of markers, then w, Y, G of each axis."""
        triad, others, pair = np.zeros((ALL, 3)), np.eye(ALL)[:, 9:COUNT], np.zeros((ALL, 3))
        triad[:9] = rigid.corners().reshape(9, 3)
        pair[COUNT : COUNT + 3] = pair[COUNT + PER_AXIS : COUNT + PER_AXIS + 3] = np.eye(3)
        columns = [triad, others, pair]
        for number, axis in enumerate(self.axes):
            for part in range(3):
                if (number, part) not in ((0, 0), (1, 0), (0, 2)):  # the two MCP axes turn together; abduction stays
                    start = COUNT + PER_AXIS * number + 3 * part
                    plane = np.linalg.svd(axis.direction[None])[2][1:].T
                    columns.append(np.eye(ALL)[:, start : start + 3] @ plane)
        return np.hstack(columns)

    def shift(self, change: np.ndarray) -> Finger:
        """Finger after a change (72,) of markers [m], directions [rad], centres [m] and slopes [m/rad]."""
        axes = []
        for axis, (turn, shift, slope) in zip(self.axes, change[COUNT:].reshape(4, 3, 3), strict=True):
            w = Rotation.from_rotvec(turn).as_matrix() @ axis.direction
            axes.append(rigid.Axis(w, rigid.across(axis.point + shift, w), rigid.across(axis.slope + slope, w)))
        return Finger(self.markers + change[:COUNT].reshape(self.markers.shape), tuple(axes))  # type: ignore[arg-type]

    def differentiate(self, function: Callable[..., np.ndarray], *given: Any) -> np.ndarray:
        """Derivatives (..., 51) [SI] of a function of the finger by its `free` changes, by central differences."""
        sides = [(self.shift(NUDGE * way), self.shift(-NUDGE * way)) for way in self.free().T]
        return np.stack([function(up, *given) - function(down, *given) for up, down in sides], axis=-1) / (2 * NUDGE)

    def places(self, angles: np.ndarray) -> np.ndarray:
        """Markers (frames, 12, 3) [m] in the frame of the base triad at angles (frames, 4) [rad]."""
        poses = rigid.chain_poses(self.axes, angles)
        triads = [rigid.apply(poses[k + 1 if k else 0], triad) for k, triad in enumerate(self.markers)]
        return np.concatenate(triads, axis=1)

    def differentiate_angles(self, place: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """Derivatives (frames, 12, 3, 4) [m/rad] of places (frames, 12, 3) [m] by abduction, MCP, PIP, DIP [rad]."""
        velocity = np.swapaxes(rigid.space_jacobian(self.axes, angles), 1, 2)[:, None]  # (frames, 1, joints, 6)
        moves = np.cross(velocity[..., :3], place[:, :, None]) + velocity[..., 3:]
        return np.swapaxes(moves * CARRIES[:, :, None], 2, 3)


class Adjusted(NamedTuple):
    """Result of the bundle adjustment."""

    finger: Finger
    covariance: np.ndarray  # (51, 51) of the coefficients of the finger's `free` changes
    noise: float  # RMS of a marker per axis [m]
    inflation: float  # factor by which correlated errors enlarge the covariance; 1 for white noise


def adjust(
    points: np.ndarray, rest: np.ndarray, start: Finger, poses: np.ndarray, angles: np.ndarray, block: int
) -> Adjusted:
    """Adjust finger, poses and angles to measured markers (frames, 12, 3) [m], NaN where missing.

    The mean angles over the frames of the mask `rest` (frames,) [-] are 0. It starts from a finger, poses of the base
    triad (frames, 4, 4) [m] and angles (frames, 4) [rad]; errors may be correlated within `block` frames.
    """
    finger, offset, change, before = start, np.zeros(ALL), np.zeros(ALL), np.inf
    seen = np.isfinite(points)
    left = np.count_nonzero(seen) * (1 - LOCAL / COUNT) - FREE  # a whole frame fits ten unknowns
    for _ in range(STEPS):
        trial = finger.shift(change)
        poses, angles = fit_frames(points, trial, poses, angles)
        error = compare_markers(points, trial.places(angles), poses)
        variance = float(np.sum(error**2) / max(left, 1))
        prior = variance * PRIOR
        if (cost := np.sum(error**2) + prior @ (offset + change) ** 2) > before * (1 + CONVERGED):
            change = change / 2
            continue
        finger, offset, free = trial, offset + change, trial.free()
        wide = (finger.differentiate(Finger.places, angles) * seen[..., None]).reshape(-1, COUNT, FREE)
        own = differentiate_frames(finger, angles, finger.places(angles), points)
        inverses = np.linalg.inv(np.swapaxes(own, 1, 2) @ own + HELD * np.eye(LOCAL))
        moves = inverses @ np.swapaxes(own, 1, 2) @ wide  # of the frames, by those of the finger
        normal = np.tensordot(wide, wide - own @ moves, axes=((0, 1), (0, 1))) + (free.T * prior) @ free
        mean, held = -moves[rest, 6:].sum(axis=0), -inverses[rest, 6:, 6:].sum(axis=0)  # of the constraint
        matrix = np.block([[normal, mean.T], [mean, held]])
        if before - cost <= CONVERGED * cost or cost < error.size * ROUNDING**2:
            break
        gradient = np.tensordot(wide, error.reshape(-1, COUNT), axes=((0, 1), (0, 1))) - free.T @ (prior * offset)
        before, change = cost, free @ np.linalg.solve(matrix, np.r_[gradient, -angles[rest].sum(axis=0)])[:FREE]
    covariance = np.linalg.inv(matrix)[:FREE, :FREE]
    # variance of sums over blocks of frames, relative to that of independent errors
    whole = error[: len(error) // block * block].reshape(-1, block, COUNT)
    sums = np.sum(whole.sum(axis=1) ** 2)
    inflation = max(1.0, float(sums / max(np.sum(whole**2), np.finfo(float).tiny)))
    return Adjusted(finger, variance * inflation * covariance, float(np.sqrt(variance)), inflation)


def fit_frames(
    points: np.ndarray, finger: Finger, poses: np.ndarray, angles: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pose (frames, 4, 4) [m] and angles (frames, 4) [rad] of each frame by Gauss-Newton; arguments as of `adjust`."""
    for _ in range(FRAME_STEPS):
        place = finger.places(angles)
        own = differentiate_frames(finger, angles, place, points)
        pull = np.swapaxes(own, 1, 2) @ compare_markers(points, place, poses).reshape(-1, COUNT, 1)
        moves = np.linalg.solve(np.swapaxes(own, 1, 2) @ own + HELD * np.eye(LOCAL), pull)[..., 0]
        poses, angles = shift_poses(poses, moves), angles + moves[:, 6:]
        if np.max(np.abs(moves), initial=0.0) < STILL:
            break
    return poses, angles


def differentiate_frames(finger: Finger, angles: np.ndarray, place: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Derivatives (frames, 36, 10) of places [m] by rotation, shift and angles of their frame [rad, m]; 0 unseen."""
    shift, by_angle = np.broadcast_to(np.eye(3), (*place.shape, 3)), finger.differentiate_angles(place, angles)
    own = np.concatenate([-rigid.hat(place), shift, by_angle], axis=3) * np.isfinite(points)[..., None]
    return own.reshape(-1, COUNT, LOCAL)


def compare_markers(points: np.ndarray, place: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Measured less predicted markers (frames, 12, 3) [m], seen from the base triad; 0 where missing."""
    return np.nan_to_num(rigid.apply(rigid.inverse(poses), points) - place)


def shift_poses(poses: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Poses (frames, 4, 4) [m] after small rotations and shifts, moves (frames, 10) [rad, m]."""
    return poses @ rigid.motion(Rotation.from_rotvec(moves[:, :3]).as_matrix(), moves[:, 3:6])


def first_guess(
    shapes: np.ndarray, poses: list[np.ndarray], rest: np.ndarray, recording: Recording, layout: Layout
) -> tuple[Finger, np.ndarray, np.ndarray]:
    """Guess the finger, poses of the base triad (frames, 4, 4) [m], and angles (frames, 4) [rad].

    From the triads (4, 3, 3) [m] of the segments, poses of each (frames, 4, 4) [m], and the mask of the rest (frames,).
    InputError for a joint that is hardly seen, is not at rest at the start, or hardly moves.
    """
    source, count = recording.source, np.arange(len(rest))
    markers, axes, angles, rested = [shapes[0]], [], [], np.eye(4)
    for k, name in enumerate(JOINTS):
        relative = rigid.inverse(poses[k]) @ poses[k + 1]
        seen = np.flatnonzero(np.isfinite(relative).all(axis=(1, 2)))
        if len(seen) < FEWEST:
            pair = layout.finger[3 * k : 3 * k + 6]
            gone = np.isnan(recording.of(pair)).any(axis=2).mean(axis=0)
            worst = int(np.argmax(gone))
            why = f", marker {pair[worst]} being missing in {100 * gone[worst]:.0f} % of them" if gone[worst] else ""
            raise InputError(
                f"{source}: {name} is seen in {len(seen)} of {len(rest)} frames{why}; at least {FEWEST} are needed"
            )
        still = relative[seen[rest[seen]]]
        if not len(still):
            raise InputError(f"{source}: {name} is not seen in the rest at the start, the posture all angles refer to")
        turned = Rotation.from_matrix(still[:, :3, :3])
        mean = turned.mean()
        if (stir := np.sqrt(np.mean((mean.inv() * turned).magnitude() ** 2))) > UNSTEADY:
            raise InputError(
                f"{source}: {name} moves by {np.rad2deg(stir):.1f} deg RMS in the rest at the start,"
                " which must show the finger straight and still"
            )
        before, rested = rested, rested @ rigid.motion(mean.as_matrix(), still[:, :3, 3].mean(axis=0))
        markers.append(rigid.apply(rested, shapes[k + 1]))
        turns, about = before @ relative[seen] @ rigid.inverse(rested), markers[-1].mean(axis=0)
        # the principal direction of w theta, where small angles weigh little; flexion is the larger excursion
        vectors = Rotation.from_matrix(turns[:, :3, :3]).as_rotvec()
        direction = np.linalg.eigh(vectors.T @ vectors)[1][:, -1]
        angle = vectors @ direction
        if np.sum(angle * np.abs(angle)) < 0:
            direction, angle = -direction, -angle
        if (beyond := np.count_nonzero(np.abs(angle) >= SMALLEST_ANGLE)) < FEWEST:
            most = np.rad2deg(np.max(np.abs(angle)))
            raise InputError(
                f"{source}: {name} turns {most:.1f} deg at most and is beyond"
                f" {np.rad2deg(SMALLEST_ANGLE):.0f} deg in {beyond} frames; its centre needs {FEWEST} such frames"
            )
        share = (2 * np.sin(angle / 2)) ** 2  # inverse relative variance of a centre
        centre = share @ np.nan_to_num(rigid.centres(turns, direction, angle, about)) / share.sum()
        if k == 0:  # abduction about distal x flexion, which points dorsally
            dorsal = np.cross(about - centre, direction)
            dorsal /= np.linalg.norm(dorsal)
            axes.append(rigid.Axis(dorsal, rigid.across(centre + direction * (about @ direction), dorsal), np.zeros(3)))
            angles.append(np.interp(count, seen, vectors @ dorsal))
        axes.append(rigid.Axis(direction, centre, np.zeros(3)))
        angles.append(np.interp(count, seen, angle))
    whole = np.flatnonzero(np.isfinite(poses[0]).all(axis=(1, 2)))
    nearest = whole[np.searchsorted(whole, count).clip(max=len(whole) - 1)]
    return Finger(np.stack(markers), tuple(axes)), poses[0][nearest], np.stack(angles, axis=1)


def smooth(time: np.ndarray, positions: np.ndarray, cutoff: float, source: str = "recording") -> np.ndarray:
    """Smooth positions (frames, markers, 3) [m], NaN where missing, at evenly spaced time (frames,) [s].

    InputError for uneven frames or a cut-off [Hz] beyond half the frame rate; it names the source.
    """
    steps = np.diff(time)
    step = float(np.median(steps))
    uneven = np.flatnonzero(np.abs(steps - step) > step / 2)
    if len(uneven):
        at, wide = f"frame {uneven[0]} at {time[uneven[0]]:g} s", 1e3 * steps[uneven[0]]
        raise InputError(f"{source}: {at} is followed after {wide:g} ms, the others after {1e3 * step:g} ms")
    if not 0 < cutoff < (top := 0.5 / step):
        raise InputError(f"{source}: cut-off {cutoff:g} Hz must lie between 0 and half the frame rate, {top:g} Hz")
    stiffness = (2 * np.sin(np.pi * cutoff * step)) ** (-2 * ORDER)
    result = positions.copy()
    for path in np.moveaxis(result, 1, 0):
        seen = np.isfinite(path).all(axis=1)
        frames = np.flatnonzero(seen)
        for run in np.split(frames, np.flatnonzero(np.diff(frames) > round(LONGEST_GAP / step) + 1) + 1):
            if len(run) > ORDER:
                part = slice(run[0], run[-1] + 1)
                options: dict[str, Any] = {"lamb": stiffness, "order": ORDER, "weights": seen[part].astype(float)}
                for column in path[part].T:
                    column[:] = whittaker_henderson(np.nan_to_num(column), **options).x
    return result


def measures(finger: Finger, tip: int) -> np.ndarray:
    """Lengths of the three phalanges, then gradient and intercept of MCP, PIP, DIP, (21,) [m, m/rad].

    Lengths are those between joint axes, the last one from the DIP axis to the distal marker `tip`. The position of a
    centre along its axis cannot be observed, so the plane through the middle of the segment's triad, normal to the mean
    direction of its two axes, serves as the middle of the finger. A gradient is in the frame of the triad before it.
    """
    _, proximal, middle, distal = finger.markers
    _, mcp, pip, dip = finger.axes

    def cross_plane(near: rigid.Axis, far: rigid.Axis, origin: np.ndarray) -> tuple[np.ndarray, ...]:
        normal = near.direction + far.direction
        normal = normal / np.linalg.norm(normal)
        shares = ((origin - axis.point) @ normal / (axis.direction @ normal) for axis in (near, far))
        return *(axis.point + axis.direction * share for axis, share in zip((near, far), shares)), normal

    start, end, _ = cross_plane(mcp, pip, proximal.mean(axis=0))
    near, far, normal = cross_plane(pip, dip, middle.mean(axis=0))
    along = (far - near) / np.linalg.norm(far - near)
    reach = rigid.across(distal[tip] - far, normal) @ along
    values = [[np.linalg.norm(end - start), np.linalg.norm(far - near), reach]]
    for triad, axis in zip(finger.markers, finger.axes[1:]):
        seen = axis.express_in(rigid.triad_pose(triad))
        values += [seen.slope, seen.point]
    return np.concatenate(values)


@dataclass(frozen=True)
class Joint:
    """Joint in the frame of the segment proximal to it; frames without markers hold NaN."""

    name: str  # MCP, PIP or DIP
    axis: rigid.Axis  # of flexion
    angle: np.ndarray  # (frames,) flexion [rad]
    centre: np.ndarray  # (frames, 3) normal to the axis, from each frame alone [m]
    covariance: np.ndarray  # (6, 6) of the axis's slope, then its point [SI]
    rmse: np.ndarray  # (3,) scatter of single centres about the line of the axis [m]
    frames: int  # in number, whose angle is large enough for that
    abduction_axis: rigid.Axis | None = None  # of the MCP
    abduction: np.ndarray | None = None  # (frames,) [rad]

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest flexion in the recording [rad]."""
        return float(np.nanmin(self.angle)), float(np.nanmax(self.angle))

    @property
    def half_widths(self) -> np.ndarray:
        """Half widths (2, 3) of the 95 % intervals of the axis's slope [m/rad] and point [m]."""
        return NORMAL_95 * np.sqrt(np.diag(self.covariance)).reshape(2, 3)

    def band(self, angle: np.ndarray) -> np.ndarray:
        """95 % half width of the centre (..., 3) [m] at angles (...) [rad]."""
        theta, shared, (slope, point) = np.asarray(angle)[..., None], np.diag(self.covariance, 3), self.half_widths
        variance = (theta * slope) ** 2 + point**2 + 2 * theta * shared * NORMAL_95**2
        return np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True)
class Kinematics:
    """Identified finger in a recording."""

    joints: tuple[Joint, Joint, Joint]
    lengths: tuple[float, float, float]  # of the phalanges [m]
    intervals: tuple[float, float, float]  # their 95 % half widths [m]
    residuals: tuple[float, ...]  # (4,) median of each triad after smoothing [m]
    noise: float  # RMS per axis of a marker [m]
    inflation: float  # factor by which errors that last for several frames enlarge the variances
    time: np.ndarray
    remarks: tuple[str, ...]  # warnings of the label check
    source: str


def identify(recording: Recording, layout: Layout | None = None, cutoff: float | None = CUTOFF) -> Kinematics:
    """Identify the kinematics of the finger in a marker recording, smoothed below a cut-off frequency [Hz].

    Raises:
        InputError: Naming file, marker and frame, for missing or swapped markers, collinear triads, too few frames,
            motion at the start, or a joint that hardly moves.
    """
    layout = layout or Layout()
    check = check_labels(recording, layout)
    if check.swaps:
        swap, frames = check.swaps[0], sum(one.last - one.first + 1 for one in check.swaps)
        raise InputError(
            f"{recording.source}: markers {swap.names[0]} and {swap.names[1]} are swapped from frame {swap.first}"
            f" ({recording.time[swap.first]:.3f} s) to {swap.last}"
            f" ({frames} swapped frames in all); correct the labels, or let --repair exchange them"
        )
    points, time = recording.of(layout.finger).copy(), recording.time
    for k, spoilt in enumerate(check.spoilt):
        points[spoilt, 3 * k : 3 * k + 3] = np.nan
    smoothed = points if cutoff is None else smooth(time, points, cutoff, recording.source)
    fits = [rigid.fit_pose(shape, smoothed[:, 3 * k : 3 * k + 3]) for k, shape in enumerate(check.shapes)]
    rest = time <= time[0] + REST
    start, poses, angles = first_guess(check.shapes, [pose for pose, _ in fits], rest, recording, layout)
    used = np.union1d(np.flatnonzero(rest)[:FRAMES], np.linspace(0, len(time) - 1, FRAMES).round().astype(int))
    block = max(1, round(BLOCK / float(np.median(np.diff(time[used])))))
    found = adjust(points[used], rest[used], start, poses[used], angles[used], block)
    _, angles = fit_frames(smoothed, found.finger, poses, angles)
    tip = layout.distal.index(layout.tip)
    values, slope = measures(found.finger, tip), found.finger.differentiate(measures, tip)
    covariance = slope @ found.covariance @ slope.T
    half = NORMAL_95 * np.sqrt(np.diag(covariance)[:3])
    finger, joints = found.finger, []
    poses = [rigid.fit_pose(triad, smoothed[:, 3 * k : 3 * k + 3])[0] for k, triad in enumerate(finger.markers)]
    for k, name in enumerate(JOINTS):
        axis, angle, side = finger.axes[k + 1], angles[:, k + 1].copy(), angles[:, 0].copy()
        turns = rigid.inverse(poses[k]) @ poses[k + 1]
        seen = np.isfinite(turns).all(axis=(1, 2))
        angle[~seen] = side[~seen] = np.nan
        if k == 0:
            turns = rigid.inverse(finger.axes[0].pose(side)) @ turns
        pose = rigid.triad_pose(finger.markers[k])
        own = axis.express_in(pose)
        centre = rigid.centres(turns, axis.direction, angle, finger.markers[k + 1].mean(axis=0))
        centre = rigid.across(rigid.apply(rigid.inverse(pose), centre), own.direction)
        part, used = slice(3 + 6 * k, 9 + 6 * k), np.abs(np.nan_to_num(angle)) >= SMALLEST_ANGLE
        rmse = np.sqrt(np.mean((centre[used] - own.point - own.slope * angle[used, None]) ** 2, axis=0))
        abduction = (None, None) if k else (finger.axes[0].express_in(pose), side)
        joints.append(Joint(name, own, angle, centre, covariance[part, part], rmse, int(used.sum()), *abduction))
    residuals = tuple(float(np.nanmedian(residual)) for _, residual in fits)
    return Kinematics(
        (joints[0], joints[1], joints[2]), tuple(values[:3].tolist()), tuple(half.tolist()),
        residuals, found.noise, found.inflation, time, check.remarks, recording.source,
    )  # fmt: skip
