"""Kinematic identification of the paper's 2.2.1: markers to joint axes, centres, angles, lengths and ranges.

Steps: check labels; fit the triads to smoothed paths for a first guess; adjust finger, poses and angles to the measured
markers of all frames together (`adjust`); read lengths and centre lines, with intervals, from the adjusted finger; and
fit its angles to the smoothed paths. Joint i is described in the frame of the triad proximal to it.

Paths are smoothed by the discrete smoothing spline (Whittaker-Henderson), which also fills short gaps:

    minimise  sum over seen frames (y - z)^2 + lambda sum (third difference of z)^2
    gain      1 / (1 + lambda (2 sin(pi f dt))^6)

lambda gives a gain of 1/2 at the cut-off frequency; at a twentieth of it the gain differs from 1 by 2e-8, so slow
finger motion is unchanged. A missing sample has no weight and takes the value of the spline; long gaps stay missing.

First guess: every joint a hinge. The poses of the triads at rest place all markers and axes in the frame of the base
triad. There the motion of a joint, the relative motion of its two segments from that posture, gives axis, angle and
centre in closed form (`axis`). The abduction axis starts through the MCP centre, normal to flexion and to the finger.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from exodrake.core.confidence import NORMAL_95
from exodrake.core.errors import InputError
from exodrake.identification.kinematics.adjust import Adjusted, Finger, adjust, fit_frames
from exodrake.identification.kinematics.markers import JOINTS, Layout, Recording
from exodrake.identification.kinematics.rigid import (
    Axis,
    SegmentMotion,
    across,
    angle_about,
    apply,
    centres,
    check_labels,
    inverse,
    joint_points,
    mean_axis,
    mean_pose,
    place,
    placed,
    refuse_swaps,
    triad_pose,
    weight,
)

FEWEST = 50  # frames in which a joint must be seen
UNSTEADY = 0.12  # rad RMS about the mean posture of the rest


@dataclass(frozen=True)
class Start:
    """First guess: finger, poses of the base triad (frames, 4, 4) [m], and angles (frames, 4) [rad]."""

    finger: Finger
    poses: np.ndarray
    angles: np.ndarray


def first_guess(segments: list[SegmentMotion], rest: np.ndarray, smallest: float, recording: Recording) -> Start:
    """Guess the finger from the motion of its segments.

    Args:
        segments: Motion of base, proximal, middle and distal segment.
        rest: (frames,) mask of the rest at the start.
        smallest: Smallest angle that shows a centre [rad].
        recording: The recording, for errors.

    Raises:
        InputError: For a joint that is hardly seen, is not at rest at the start, or hardly moves.
    """
    markers, axes, angles, rested = [segments[0].triad.shape], [], [], np.eye(4)
    for k, name in enumerate(JOINTS):
        relative = inverse(segments[k].pose) @ segments[k + 1].pose
        seen = np.isfinite(relative).all(axis=(1, 2))
        if np.count_nonzero(seen) < FEWEST:
            raise InputError(f"{_scarce(name, segments[k : k + 2], seen, recording)}; at least {FEWEST} are needed")
        reference = _reference(name, relative[seen & rest], recording)
        before, rested = rested, rested @ reference
        markers.append(apply(rested, segments[k + 1].triad.shape))
        turns = before @ relative[seen] @ inverse(rested)
        axis, angle = _hinge(turns, markers[-1].mean(axis=0))
        beyond = np.count_nonzero(np.abs(angle) >= smallest)
        if beyond < FEWEST:
            most = np.rad2deg(np.nanmax(np.abs(angle)))
            raise InputError(
                f"{recording.source}: {name} turns {most:.1f} deg at most and is beyond"
                f" {np.rad2deg(smallest):.0f} deg in {beyond} frames; its centre needs {FEWEST} such frames"
            )
        if k == 0:
            side = _abduction(axis, markers[-1].mean(axis=0))
            axes.append(side)
            angles.append(_filled(Rotation.from_matrix(turns[:, :3, :3]).as_rotvec() @ side.direction, seen))
        axes.append(axis)
        angles.append(_filled(angle, seen))
    whole = np.flatnonzero(np.isfinite(segments[0].pose).all(axis=(1, 2)))
    nearest = whole[np.abs(np.searchsorted(whole, np.arange(len(rest))).clip(max=len(whole) - 1))]
    return Start(Finger(np.stack(markers), tuple(axes)), segments[0].pose[nearest], np.stack(angles, axis=1))


def _hinge(turns: np.ndarray, about: np.ndarray) -> tuple[Axis, np.ndarray]:
    """Axis with a centre that stays in place, and angle (frames,) [rad]."""
    direction = mean_axis(turns[:, :3, :3])
    angle = angle_about(turns[:, :3, :3], direction)
    share = weight(angle)
    centre = share @ np.nan_to_num(centres(turns, direction, angle, about)) / share.sum()
    return Axis(direction, centre, np.zeros(3)), angle


def _abduction(flexion: Axis, markers: np.ndarray) -> Axis:
    """Abduction about distal x flexion, which points dorsally."""
    dorsal = np.cross(markers - flexion.point, flexion.direction)
    direction = dorsal / np.linalg.norm(dorsal)
    point = flexion.point + flexion.direction * (markers @ flexion.direction)
    return Axis(direction, across(point, direction), np.zeros(3))


def _filled(values: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Values (frames,) of all frames from those of the seen ones, by interpolation."""
    return np.interp(np.arange(len(seen)), np.flatnonzero(seen), values)


def _reference(name: str, still: np.ndarray, recording: Recording) -> np.ndarray:
    """Mean (4, 4) of the relative poses at rest (frames, 4, 4) [m]. InputError if there are none, or they move."""
    if not len(still):
        raise InputError(
            f"{recording.source}: {name} is not seen in the rest at the start, the posture all angles refer to"
        )
    reference = mean_pose(still)
    turned = inverse(reference)[:3, :3] @ still[:, :3, :3]
    stir = float(np.sqrt(np.mean(np.sum((turned - np.eye(3)) ** 2, axis=(1, 2))) / 2))
    if stir > UNSTEADY:
        raise InputError(
            f"{recording.source}: {name} moves by {np.rad2deg(stir):.1f} deg RMS in the rest at the start,"
            " which must show the finger straight and still"
        )
    return reference


def _scarce(name: str, pair: list[SegmentMotion], seen: np.ndarray, recording: Recording) -> str:
    """Say which marker is missing most where a joint is unseen."""
    markers = [marker for segment in pair for marker in segment.triad.names]
    gone = np.isnan(recording.of(tuple(markers))).any(axis=2).mean(axis=0)
    worst = int(np.argmax(gone))
    why = f", marker {markers[worst]} being missing in {100 * gone[worst]:.0f} % of them" if gone[worst] > 0 else ""
    return f"{recording.source}: {name} is seen in {np.count_nonzero(seen)} of {len(seen)} frames{why}"


ORDER = 3


def smooth(
    time: np.ndarray, positions: np.ndarray, cutoff: float, longest_gap: float, source: str = "recording"
) -> np.ndarray:
    """Smooth marker paths.

    Args:
        time: (frames,) evenly spaced [s].
        positions: (frames, markers, 3) [m], NaN where missing.
        cutoff: Cut-off frequency [Hz].
        longest_gap: Longest gap to fill [s].
        source: Name of the recording, for errors.

    Returns:
        Smoothed positions (frames, markers, 3) [m].

    Raises:
        InputError: For uneven frames or a cut-off beyond half the frame rate.
    """
    step = _even_step(time, source)
    if not 0 < cutoff < 0.5 / step:
        raise InputError(
            f"{source}: cut-off {cutoff:g} Hz must lie between 0 and half the frame rate, {0.5 / step:g} Hz"
        )
    stiffness = (2 * np.sin(np.pi * cutoff * step)) ** (-2 * ORDER)
    result = np.full_like(positions, np.nan)
    for number in range(positions.shape[1]):
        seen = np.isfinite(positions[:, number]).all(axis=1)
        for start, stop in _segments(seen, round(longest_gap / step)):
            segment = slice(start, stop)
            result[segment, number] = _spline(positions[segment, number], seen[segment], stiffness)
    return result


def _even_step(time: np.ndarray, source: str) -> float:
    steps = np.diff(time)
    step = float(np.median(steps))
    uneven = np.abs(steps - step) > step / 2
    if uneven.any():
        where = int(np.argmax(uneven))
        at, wide = time[where], 1e3 * steps[where]
        raise InputError(
            f"{source}: frame {where} at {at:g} s is followed after {wide:g} ms, the others after {1e3 * step:g} ms"
        )
    return step


def _segments(seen: np.ndarray, gap: int) -> list[tuple[int, int]]:
    """First and one past last frame of each segment without a gap longer than `gap` frames."""
    frames = np.flatnonzero(seen)
    if not len(frames):
        return []
    breaks = np.flatnonzero(np.diff(frames) > gap + 1)
    starts, stops = np.r_[frames[0], frames[breaks + 1]], np.r_[frames[breaks], frames[-1]]
    return [(int(a), int(b) + 1) for a, b in zip(starts, stops, strict=True)]


def _spline(path: np.ndarray, seen: np.ndarray, stiffness: float) -> np.ndarray:
    """Smooth one segment: path (n, 3) [m] and mask (n,) to z (n, 3) [m]."""
    from scipy.signal import whittaker_henderson

    if np.count_nonzero(seen) <= ORDER:
        return np.where(seen[:, None], path, np.nan)
    columns = np.where(seen[:, None], path, 0.0).T
    options = {"lamb": stiffness, "order": ORDER, "weights": seen.astype(float)}
    return np.stack([whittaker_henderson(column, **options).x for column in columns], axis=1)


@dataclass(frozen=True)
class CentreLine:
    """Centre = gradient theta + intercept, per axis of the frame proximal to the joint.

    Attributes:
        gradient: (3,) [m/rad].
        intercept: (3,) [m].
        covariance: (6, 6) of gradient, then intercept [m2].
        rmse: (3,) scatter about the line of the centres of single frames [m].
        frames: Number of frames with a large enough angle for that scatter.
    """

    gradient: np.ndarray
    intercept: np.ndarray
    covariance: np.ndarray
    rmse: np.ndarray
    frames: int

    @property
    def gradient_interval(self) -> np.ndarray:
        """Half width (3,) of the 95 % interval [m/rad]."""
        return NORMAL_95 * np.sqrt(np.diag(self.covariance)[:3])

    @property
    def intercept_interval(self) -> np.ndarray:
        """Half width (3,) of the 95 % interval [m]."""
        return NORMAL_95 * np.sqrt(np.diag(self.covariance)[3:])

    @property
    def rmse_3d(self) -> float:
        """Root of the sum of squares of the RMSE of the three axes [m]."""
        return float(np.linalg.norm(self.rmse))

    def at(self, angle: np.ndarray) -> np.ndarray:
        """Centre (..., 3) [m] at angles (...) [rad]."""
        return self.intercept + self.gradient * np.asarray(angle)[..., None]

    def band(self, angle: np.ndarray) -> np.ndarray:
        """95 % half width of the line (..., 3) [m] at angles (...) [rad]."""
        theta, (slope, shared, level) = np.asarray(angle)[..., None], self._variances()
        return NORMAL_95 * np.sqrt(np.maximum(theta**2 * slope + 2 * theta * shared + level, 0.0))

    def _variances(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Variance of the gradient, covariance, and variance of the intercept, (3,) each [m2]."""
        return np.diag(self.covariance)[:3], np.diag(self.covariance, 3), np.diag(self.covariance)[3:]


STEP = 1e-6  # m, rad, m/rad; of the difference quotient


def measures(finger: Finger, tip: int) -> np.ndarray:
    """Lengths of the three phalanges, then gradient and intercept of MCP, PIP, DIP in the frame of the triad before it.

    Args:
        finger: The finger.
        tip: Number of the distal marker at the fingertip.

    Returns:
        Values (21,) [m, m/rad].
    """
    values = [phalanx_lengths(finger, tip)]
    for triad, axis in zip(finger.markers, finger.axes[1:]):
        seen = axis.seen_from(triad_pose(triad))
        values += [seen.slope, seen.point]
    return np.concatenate(values)


def phalanx_lengths(finger: Finger, tip: int) -> np.ndarray:
    """Phalanx lengths (3,) [m]: between joint axes, in the plane through the triad; from DIP axis to tip marker.

    The position of a centre along its axis cannot be observed, so the plane through the middle of the segment's triad,
    normal to the mean direction of its two axes, serves as the middle of the finger.
    """
    _, proximal, middle, distal = finger.markers
    _, mcp, pip, dip = finger.axes
    start, end, _ = joint_points(mcp, pip, proximal.mean(axis=0))
    near, far, normal = joint_points(pip, dip, middle.mean(axis=0))
    along = (far - near) / np.linalg.norm(far - near)
    reach = across(distal[tip] - far, normal) @ along
    return np.array([np.linalg.norm(end - start), np.linalg.norm(far - near), reach])


def measured(adjusted: Adjusted, tip: int) -> tuple[np.ndarray, np.ndarray]:
    """Values (21,) of `measures` and their covariance (21, 21) [SI]."""
    finger, free = adjusted.finger, adjusted.finger.free()
    columns = [
        (measures(finger.moved(STEP * way), tip) - measures(finger.moved(-STEP * way), tip)) / (2 * STEP)
        for way in free.T
    ]
    slope = np.stack(columns, axis=1)
    return measures(finger, tip), slope @ adjusted.covariance @ slope.T


FRAMES = 4000  # of the adjustment, equispaced beside the rest: they cover minutes of recording


@dataclass(frozen=True)
class Settings:
    """Settings of the identification.

    Attributes:
        cutoff: Cut-off frequency of the smoothing [Hz]; None for none.
        longest_gap: Longest gap that is filled [s].
        rest: Duration of rest at the start [s].
        smallest_angle: Smallest angle whose centres are shown and measured against their line [rad].
        block: Time within which errors may be correlated [s].
    """

    cutoff: float | None = 4.0
    longest_gap: float = 0.2
    rest: float = 1.0
    smallest_angle: float = 0.3
    block: float = 1.0


@dataclass(frozen=True)
class Joint:
    """Joint in the frame of the segment proximal to it; frames without markers hold NaN.

    Attributes:
        name: MCP, PIP or DIP.
        axis: Flexion axis.
        angle: (frames,) flexion [rad].
        centre: (frames, 3) centre normal to the axis, from each frame alone [m].
        line: Line of the centre over the angle.
        smallest_angle: Smallest angle of the centres that are measured against the line [rad].
        abduction_axis: Abduction axis (MCP only).
        abduction: (frames,) abduction [rad] (MCP only).
    """

    name: str
    axis: Axis
    angle: np.ndarray
    centre: np.ndarray
    line: CentreLine
    smallest_angle: float
    abduction_axis: Axis | None = None
    abduction: np.ndarray | None = None

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest flexion in the recording [rad]."""
        return float(np.nanmin(self.angle)), float(np.nanmax(self.angle))


@dataclass(frozen=True)
class Kinematics:
    """Identified finger.

    Attributes:
        joints: MCP, PIP, DIP.
        lengths: (3,) phalanx lengths [m].
        intervals: (3,) 95 % half widths of the lengths [m].
        residuals: (4,) median residual of each triad after smoothing [m].
        noise: RMS noise per axis of a marker [m].
        inflation: Factor by which errors that last for several frames enlarge the variances.
        time: (frames,) [s].
        remarks: Warnings of the label check.
        source: Name of the recording.
    """

    joints: tuple[Joint, Joint, Joint]
    lengths: tuple[float, float, float]
    intervals: tuple[float, float, float]
    residuals: tuple[float, ...]
    noise: float
    inflation: float
    time: np.ndarray
    remarks: tuple[str, ...]
    source: str


def identify(recording: Recording, layout: Layout | None = None, settings: Settings | None = None) -> Kinematics:
    """Identify the kinematics of the finger in a marker recording.

    Args:
        recording: Marker positions.
        layout: Marker names of each segment.
        settings: Settings of the identification.

    Raises:
        InputError: Naming file, marker and frame, for missing or swapped markers, collinear triads, too few frames,
            motion at the start, or a joint that hardly moves.
    """
    layout, settings = layout or Layout(), settings or Settings()
    check = check_labels(recording, layout)
    refuse_swaps(check, recording)
    points, time = recording.of(layout.finger).copy(), recording.time
    for k, spoilt in enumerate(check.spoilt):
        points[spoilt, 3 * k : 3 * k + 3] = np.nan
    smoothed = points
    if settings.cutoff is not None:
        smoothed = smooth(time, points, settings.cutoff, settings.longest_gap, recording.source)
    segments = [place(triad, smoothed[:, 3 * k : 3 * k + 3]) for k, triad in enumerate(check.triads)]
    rest = time <= time[0] + settings.rest
    start = first_guess(segments, rest, settings.smallest_angle, recording)
    used = np.union1d(np.flatnonzero(rest)[:FRAMES], np.linspace(0, len(time) - 1, FRAMES).round().astype(int))
    block = max(1, round(settings.block / float(np.median(np.diff(time[used])))))
    found = adjust(points[used], rest[used], start.finger, start.poses[used], start.angles[used], block)
    angles = fit_frames(smoothed, found.finger, start.poses, start.angles)
    values, covariance = measured(found, layout.distal.index(layout.tip))
    half = NORMAL_95 * np.sqrt(np.diag(covariance)[:3])
    joints = []
    for k in range(3):
        part = slice(3 + 6 * k, 9 + 6 * k)
        joints.append(_joint(k, found.finger, smoothed, angles, values[part], covariance[part, part], settings))
    residuals = tuple(float(np.nanmedian(s.residual)) for s in segments)
    return Kinematics(
        tuple(joints), tuple(values[:3].tolist()), tuple(half.tolist()), residuals, found.noise, found.inflation, time,
        check.remarks, recording.source,
    )  # fmt: skip


def _joint(
    k: int, finger: Finger, points: np.ndarray, angles: np.ndarray, values: np.ndarray, covariance: np.ndarray,
    settings: Settings,
) -> Joint:  # fmt: skip
    """Describe joint k; values (6,) [m/rad, m] are its gradient and intercept, with their covariance (6, 6)."""
    axis, angle, side = finger.axes[k + 1], angles[:, k + 1].copy(), angles[:, 0].copy()
    near, far = (placed(finger.markers[i], points[:, 3 * i : 3 * i + 3])[0] for i in (k, k + 1))
    turns = inverse(near) @ far
    seen = np.isfinite(turns).all(axis=(1, 2))
    angle[~seen] = side[~seen] = np.nan
    if k == 0:
        turns = inverse(finger.axes[0].pose(side)) @ turns
    pose = triad_pose(finger.markers[k])
    own = axis.seen_from(pose)
    centre = centres(turns, axis.direction, angle, finger.markers[k + 1].mean(axis=0))
    centre = across(apply(inverse(pose), centre), own.direction)
    gradient, intercept = values[:3], values[3:]
    used = np.abs(np.nan_to_num(angle)) >= settings.smallest_angle
    error = centre[used] - intercept - gradient * angle[used, None]
    line = CentreLine(gradient, intercept, covariance, np.sqrt(np.mean(error**2, axis=0)), len(error))
    abduction_axis, abduction = (None, None) if k else (finger.axes[0].seen_from(pose), side)
    return Joint(JOINTS[k], own, angle, centre, line, settings.smallest_angle, abduction_axis, abduction)
