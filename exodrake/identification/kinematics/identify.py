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
    across,
    apply,
    centres,
    check_labels,
    fit_pose,
    inverse,
    motion,
    triad_pose,
)

FEWEST = 50  # frames in which a joint must be seen
UNSTEADY = 0.12  # rad RMS about the mean posture of the rest


def first_guess(
    shapes: np.ndarray, poses: list[np.ndarray], rest: np.ndarray, recording: Recording, layout: Layout
) -> tuple[Finger, np.ndarray, np.ndarray]:
    """Guess the finger from the motion of its segments.

    Args:
        shapes: (4, 3, 3) triads of base, proximal, middle and distal segment [m].
        poses: of each of them (frames, 4, 4) [m].
        rest: (frames,) mask of the rest at the start.
        recording: The recording, for errors.
        layout: Names of the markers, for errors.

    Returns:
        The finger, poses of the base triad (frames, 4, 4) [m], and angles (frames, 4) [rad].

    Raises:
        InputError: For a joint that is hardly seen, is not at rest at the start, or hardly moves.
    """
    source, count = recording.source, np.arange(len(rest))
    markers, axes, angles, rested = [shapes[0]], [], [], np.eye(4)
    for k, name in enumerate(JOINTS):
        relative = inverse(poses[k]) @ poses[k + 1]
        seen = np.flatnonzero(np.isfinite(relative).all(axis=(1, 2)))
        if len(seen) < FEWEST:
            pair = layout.finger[3 * k : 3 * k + 6]
            gone = np.isnan(recording.of(pair)).any(axis=2).mean(axis=0)
            worst = int(np.argmax(gone))
            why = f", marker {pair[worst]} being missing in {100 * gone[worst]:.0f} % of them" if gone[worst] else ""
            raise InputError(
                f"{source}: {name} is seen in {len(seen)} of {len(rest)} frames{why}; at least {FEWEST} are needed"
            )
        reference = _rest_pose(name, relative[seen[rest[seen]]], source)
        before, rested = rested, rested @ reference
        markers.append(apply(rested, shapes[k + 1]))
        turns, about = before @ relative[seen] @ inverse(rested), markers[-1].mean(axis=0)
        turned = Rotation.from_matrix(turns[:, :3, :3])
        axis, angle = _hinge(turns, turned, about)
        beyond = np.count_nonzero(np.abs(angle) >= SMALLEST_ANGLE)
        if beyond < FEWEST:
            most = np.rad2deg(np.nanmax(np.abs(angle)))
            raise InputError(
                f"{source}: {name} turns {most:.1f} deg at most and is beyond"
                f" {np.rad2deg(SMALLEST_ANGLE):.0f} deg in {beyond} frames; its centre needs {FEWEST} such frames"
            )
        if k == 0:  # abduction about distal x flexion, which points dorsally
            dorsal = np.cross(about - axis.point, axis.direction)
            dorsal /= np.linalg.norm(dorsal)
            point = axis.point + axis.direction * (about @ axis.direction)
            axes.append(Axis(dorsal, across(point, dorsal), np.zeros(3)))
            angles.append(np.interp(count, seen, turned.as_rotvec() @ dorsal))
        axes.append(axis)
        angles.append(np.interp(count, seen, angle))
    whole = np.flatnonzero(np.isfinite(poses[0]).all(axis=(1, 2)))
    nearest = whole[np.searchsorted(whole, count).clip(max=len(whole) - 1)]
    return Finger(np.stack(markers), tuple(axes)), poses[0][nearest], np.stack(angles, axis=1)


def _hinge(turns: np.ndarray, turned: Rotation, about: np.ndarray) -> tuple[Axis, np.ndarray]:
    """Axis with a centre that stays in place, and angle (frames,) [rad], of motions (frames, 4, 4) from the rest.

    The direction is the principal one of w sin theta, so small angles have little weight; it is positive towards the
    larger excursion (flexion). The angle about it is that of the nearest rotation, by the quaternion.
    """
    quaternion = turned.as_quat(canonical=True)
    sines = 2 * quaternion[:, 3:] * quaternion[:, :3]
    direction = np.linalg.eigh(sines.T @ sines)[1][:, -1]
    along = sines @ direction
    direction = direction if np.sum(along * np.abs(along)) >= 0 else -direction
    angle = 2 * np.arctan2(quaternion[:, :3] @ direction, quaternion[:, 3])
    share = (2 * np.sin(angle / 2)) ** 2  # inverse relative variance of a centre
    centre = share @ np.nan_to_num(centres(turns, direction, angle, about)) / share.sum()
    return Axis(direction, centre, np.zeros(3)), angle


def _rest_pose(name: str, still: np.ndarray, source: str) -> np.ndarray:
    """Mean (4, 4) of the relative poses at rest (frames, 4, 4) [m]. InputError if there are none, or they move."""
    if not len(still):
        raise InputError(f"{source}: {name} is not seen in the rest at the start, the posture all angles refer to")
    mean = Rotation.from_matrix(still[:, :3, :3]).mean().as_matrix()
    stir = float(np.sqrt(np.mean(np.sum((mean.T @ still[:, :3, :3] - np.eye(3)) ** 2, axis=(1, 2))) / 2))
    if stir > UNSTEADY:
        raise InputError(
            f"{source}: {name} moves by {np.rad2deg(stir):.1f} deg RMS in the rest at the start,"
            " which must show the finger straight and still"
        )
    return motion(mean, still[:, :3, 3].mean(axis=0))


ORDER = 3


def smooth(time: np.ndarray, positions: np.ndarray, cutoff: float, source: str = "recording") -> np.ndarray:
    """Smooth marker paths.

    Args:
        time: (frames,) evenly spaced [s].
        positions: (frames, markers, 3) [m], NaN where missing.
        cutoff: Cut-off frequency [Hz].
        source: Name of the recording, for errors.

    Returns:
        Smoothed positions (frames, markers, 3) [m].

    Raises:
        InputError: For uneven frames or a cut-off beyond half the frame rate.
    """
    from scipy.signal import whittaker_henderson

    steps = np.diff(time)
    step = float(np.median(steps))
    uneven = np.abs(steps - step) > step / 2
    if uneven.any():
        where = int(np.argmax(uneven))
        at, wide = time[where], 1e3 * steps[where]
        raise InputError(
            f"{source}: frame {where} at {at:g} s is followed after {wide:g} ms, the others after {1e3 * step:g} ms"
        )
    if not 0 < cutoff < 0.5 / step:
        raise InputError(
            f"{source}: cut-off {cutoff:g} Hz must lie between 0 and half the frame rate, {0.5 / step:g} Hz"
        )
    stiffness = (2 * np.sin(np.pi * cutoff * step)) ** (-2 * ORDER)
    result = np.full_like(positions, np.nan)
    for number, path in enumerate(np.moveaxis(positions, 1, 0)):
        seen = np.isfinite(path).all(axis=1)
        frames = np.flatnonzero(seen)
        for run in np.split(frames, np.flatnonzero(np.diff(frames) > round(LONGEST_GAP / step) + 1) + 1):
            part = slice(run[0], run[-1] + 1) if len(run) else slice(0)
            if len(run) <= ORDER:
                result[part, number] = path[part]
                continue
            weights = seen[part].astype(float)
            for axis, column in enumerate(np.nan_to_num(path[part]).T):
                fit = whittaker_henderson(column, lamb=stiffness, order=ORDER, weights=weights)
                result[part, number, axis] = fit.x
    return result


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
        theta = np.asarray(angle)[..., None]
        slope, shared, level = np.diag(self.covariance)[:3], np.diag(self.covariance, 3), np.diag(self.covariance)[3:]
        return NORMAL_95 * np.sqrt(np.maximum(theta**2 * slope + 2 * theta * shared + level, 0.0))


STEP = 1e-6  # m, rad, m/rad; of the difference quotient


def measures(finger: Finger, tip: int) -> np.ndarray:
    """Lengths of the three phalanges, then gradient and intercept of MCP, PIP, DIP in the frame of the triad before it.

    Lengths are those between joint axes, the last one from the DIP axis to the tip marker. The position of a centre
    along its axis cannot be observed, so the plane through the middle of the segment's triad, normal to the mean
    direction of its two axes, serves as the middle of the finger.

    Args:
        finger: The finger.
        tip: Number of the distal marker at the fingertip.

    Returns:
        Values (21,) [m, m/rad].
    """
    _, proximal, middle, distal = finger.markers
    _, mcp, pip, dip = finger.axes

    def crossings(near: Axis, far: Axis, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        normal = near.direction + far.direction
        normal = normal / np.linalg.norm(normal)
        a, b = (
            axis.point + axis.direction * ((origin - axis.point) @ normal) / (axis.direction @ normal)
            for axis in (near, far)
        )
        return a, b, normal

    start, end, _ = crossings(mcp, pip, proximal.mean(axis=0))
    near, far, normal = crossings(pip, dip, middle.mean(axis=0))
    along = (far - near) / np.linalg.norm(far - near)
    reach = across(distal[tip] - far, normal) @ along
    values = [[np.linalg.norm(end - start), np.linalg.norm(far - near), reach]]
    for triad, axis in zip(finger.markers, finger.axes[1:]):
        seen = axis.seen_from(triad_pose(triad))
        values += [seen.slope, seen.point]
    return np.concatenate(values)


def measure(adjusted: Adjusted, tip: int) -> tuple[np.ndarray, np.ndarray]:
    """Values (21,) of `measures` and their covariance (21, 21) [SI]."""
    finger, free = adjusted.finger, adjusted.finger.free()
    columns = [
        (measures(finger.shift(STEP * way), tip) - measures(finger.shift(-STEP * way), tip)) / (2 * STEP)
        for way in free.T
    ]
    slope = np.stack(columns, axis=1)
    return measures(finger, tip), slope @ adjusted.covariance @ slope.T


FRAMES = 4000  # of the adjustment, equispaced beside the rest: they cover minutes of recording
CUTOFF = 4.0  # Hz, of the smoothing
LONGEST_GAP = 0.2  # s, longest gap that is filled
REST = 1.0  # s, duration of the rest at the start
SMALLEST_ANGLE = 0.3  # rad, whose centres are shown and measured against their line
BLOCK = 1.0  # s, time within which errors may be correlated


@dataclass(frozen=True)
class Joint:
    """Joint in the frame of the segment proximal to it; frames without markers hold NaN.

    Attributes:
        name: MCP, PIP or DIP.
        axis: Flexion axis.
        angle: (frames,) flexion [rad].
        centre: (frames, 3) centre normal to the axis, from each frame alone [m].
        line: Line of the centre over the angle.
        abduction_axis: Abduction axis (MCP only).
        abduction: (frames,) abduction [rad] (MCP only).
    """

    name: str
    axis: Axis
    angle: np.ndarray
    centre: np.ndarray
    line: CentreLine
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


def identify(recording: Recording, layout: Layout | None = None, cutoff: float | None = CUTOFF) -> Kinematics:
    """Identify the kinematics of the finger in a marker recording.

    Args:
        recording: Marker positions.
        layout: Marker names of each segment.
        cutoff: Cut-off frequency of the smoothing [Hz]; None for none.

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
    smoothed = points
    if cutoff is not None:
        smoothed = smooth(time, points, cutoff, recording.source)
    fits = [fit_pose(shape, smoothed[:, 3 * k : 3 * k + 3]) for k, shape in enumerate(check.shapes)]
    rest = time <= time[0] + REST
    start, poses, angles = first_guess(check.shapes, [pose for pose, _ in fits], rest, recording, layout)
    used = np.union1d(np.flatnonzero(rest)[:FRAMES], np.linspace(0, len(time) - 1, FRAMES).round().astype(int))
    block = max(1, round(BLOCK / float(np.median(np.diff(time[used])))))
    found = adjust(points[used], rest[used], start, poses[used], angles[used], block)
    angles = fit_frames(smoothed, found.finger, poses, angles)
    values, covariance = measure(found, layout.distal.index(layout.tip))
    half = NORMAL_95 * np.sqrt(np.diag(covariance)[:3])
    parts = [slice(3 + 6 * k, 9 + 6 * k) for k in range(3)]
    joints = tuple(
        _joint(k, found.finger, smoothed, angles, values[part], covariance[part, part]) for k, part in enumerate(parts)
    )
    residuals = tuple(float(np.nanmedian(residual)) for _, residual in fits)
    return Kinematics(
        (joints[0], joints[1], joints[2]), tuple(values[:3].tolist()), tuple(half.tolist()),
        residuals, found.noise, found.inflation, time, check.remarks, recording.source,
    )  # fmt: skip


def _joint(
    k: int, finger: Finger, points: np.ndarray, angles: np.ndarray, values: np.ndarray, covariance: np.ndarray
) -> Joint:
    """Describe joint k; values (6,) [m/rad, m] are its gradient and intercept, with their covariance (6, 6)."""
    axis, angle, side = finger.axes[k + 1], angles[:, k + 1].copy(), angles[:, 0].copy()
    near, far = (fit_pose(finger.markers[i], points[:, 3 * i : 3 * i + 3])[0] for i in (k, k + 1))
    turns = inverse(near) @ far
    seen = np.isfinite(turns).all(axis=(1, 2))
    angle[~seen] = side[~seen] = np.nan
    if k == 0:
        turns = inverse(finger.axes[0].pose(side)) @ turns
    pose = triad_pose(finger.markers[k])
    own = axis.seen_from(pose)
    centre = centres(turns, axis.direction, angle, finger.markers[k + 1].mean(axis=0))
    centre = across(apply(inverse(pose), centre), own.direction)
    used = np.abs(np.nan_to_num(angle)) >= SMALLEST_ANGLE
    error = centre[used] - values[3:] - values[:3] * angle[used, None]
    line = CentreLine(values[:3], values[3:], covariance, np.sqrt(np.mean(error**2, axis=0)), len(error))
    abduction_axis, abduction = (None, None) if k else (finger.axes[0].seen_from(pose), side)
    return Joint(JOINTS[k], own, angle, centre, line, abduction_axis, abduction)
