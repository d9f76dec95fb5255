"""Kinematic identification of the paper's 2.2.1: markers to joint axes, centres, angles, lengths and ranges.

Steps: check labels, smooth paths, fit triads, express each segment in the frame of the proximal one, and decompose the
motion from the posture of the first second into two axes at the MCP and one at PIP and DIP. Joint i is described in the
frame of the segment proximal to it.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from exodrake.core.errors import InputError
from exodrake.identification.kinematics.axis import Axis, across, joint_length, joint_points
from exodrake.identification.kinematics.frames import SegmentMotion, mean_pose, place
from exodrake.identification.kinematics.hinge import angle_about, centres, mean_axis, weight
from exodrake.identification.kinematics.labels import check_labels, refuse_swaps
from exodrake.identification.kinematics.layout import JOINTS, Layout
from exodrake.identification.kinematics.line import CentreLine, centre_line
from exodrake.identification.kinematics.markers import Recording
from exodrake.identification.kinematics.newton import joint_angles, pose_metric
from exodrake.identification.kinematics.screws import apply, inverse
from exodrake.identification.kinematics.smooth import smooth
from exodrake.identification.kinematics.two_axis import two_axes

FEWEST = 50  # frames in which a joint must be seen
UNSTEADY = 0.12  # rad RMS about the mean posture of the first second


@dataclass(frozen=True)
class Settings:
    """Settings of the identification.

    Attributes:
        cutoff: Cut-off frequency of the smoothing [Hz]; None for none.
        longest_gap: Longest gap that is filled [s].
        rest: Duration of rest at the start [s].
        smallest_angle: Smallest angle whose centres enter the regression [rad].
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
        centre: (frames, 3) centre normal to the axis [m].
        reference: (4, 4) pose of the distal segment at rest [m].
        line: Line through the centres beyond `smallest_angle`.
        smallest_angle: Smallest angle of the line [rad].
        abduction_axis: Abduction axis (MCP only).
        abduction: (frames,) abduction [rad] (MCP only).
    """

    name: str
    axis: Axis
    angle: np.ndarray
    centre: np.ndarray
    reference: np.ndarray
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
        residuals: (4,) median residual of each triad [m].
        time: (frames,) [s].
        remarks: Warnings of the label check.
        source: Name of the recording.
    """

    joints: tuple[Joint, Joint, Joint]
    lengths: tuple[float, float, float]
    intervals: tuple[float, float, float]
    residuals: tuple[float, ...]
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
    points = recording.of(layout.finger).copy()
    for k, spoilt in enumerate(check.spoilt):
        points[spoilt, 3 * k : 3 * k + 3] = np.nan
    if settings.cutoff is not None:
        points = smooth(recording.time, points, settings.cutoff, settings.longest_gap, recording.source)
    segments = [place(triad, points[:, 3 * k : 3 * k + 3]) for k, triad in enumerate(check.triads)]
    joints = tuple(_joint(k, segments, recording, settings) for k in range(3))
    lengths, intervals = _lengths(joints, segments, layout)
    residuals = tuple(float(np.nanmedian(s.residual)) for s in segments)
    return Kinematics(joints, lengths, intervals, residuals, recording.time, check.remarks, recording.source)  # type: ignore[arg-type]


def _joint(k: int, segments: list[SegmentMotion], recording: Recording, settings: Settings) -> Joint:
    """Identify joint k, between segments k and k + 1."""
    name, time = JOINTS[k], recording.time
    relative = inverse(segments[k].pose) @ segments[k + 1].pose
    seen = np.isfinite(relative).all(axis=(1, 2))
    if np.count_nonzero(seen) < FEWEST:
        raise InputError(f"{_scarce(name, segments[k : k + 2], seen, recording)}; at least {FEWEST} are needed")
    reference = _reference(name, relative, seen & (time <= time[0] + settings.rest), recording, settings)
    turns = relative[seen] @ inverse(reference)
    markers = apply(reference, segments[k + 1].triad.shape)
    split = _split_mcp if k == 0 else _split_hinge
    metric = pose_metric(turns, markers, segments[k].triad.shape)
    axis, angle, centre, sideways = split(turns, markers, metric)
    used = np.abs(angle) >= settings.smallest_angle
    if np.count_nonzero(used) < FEWEST:
        most = np.rad2deg(np.nanmax(np.abs(angle)))
        raise InputError(
            f"{recording.source}: {name} turns {most:.1f} deg at most and is beyond"
            f" {np.rad2deg(settings.smallest_angle):.0f} deg in {np.count_nonzero(used)} frames;"
            f" its centre needs {FEWEST} such frames"
        )
    block = max(1, round(settings.block / float(np.median(np.diff(time)))))
    line = centre_line(angle[used], centre[used], weight(angle[used]), block)
    found = Axis(axis.direction, line.intercept, line.gradient)
    full = [_back(values, seen) for values in (angle, centre)]
    joint = Joint(name, found, full[0], full[1], reference, line, settings.smallest_angle)
    return joint if sideways is None else replace(joint, abduction_axis=sideways[0], abduction=_back(sideways[1], seen))


def _split_hinge(turns: np.ndarray, markers: np.ndarray, metric: np.ndarray):
    """Axis, angle and centre of a one-axis joint, and None for the abduction it lacks."""
    direction = mean_axis(turns[:, :3, :3])
    angle = angle_about(turns[:, :3, :3], direction)
    return (
        Axis(direction, np.zeros(3), np.zeros(3)),
        angle,
        centres(turns, direction, angle, markers.mean(axis=0)),
        None,
    )


def _split_mcp(turns: np.ndarray, markers: np.ndarray, metric: np.ndarray):
    """Axis, angle and centre of flexion of the two-axis joint without abduction, and (abduction axis, angle)."""
    abduction, flexion = two_axes(turns, markers, metric)
    angles = joint_angles((abduction, flexion), turns, metric)
    bent = inverse(abduction.pose(angles[:, 0])) @ turns
    angle = angles[:, 1]
    return flexion, angle, centres(bent, flexion.direction, angle, markers.mean(axis=0)), (abduction, angles[:, 0])


def _reference(
    name: str, relative: np.ndarray, still: np.ndarray, recording: Recording, settings: Settings
) -> np.ndarray:
    """Mean pose (4, 4) over the rest at the start. InputError if it is not seen there or moves."""
    if not still.any():
        raise InputError(
            f"{recording.source}: {name} is not seen in the first {settings.rest:g} s, the posture all angles refer to"
        )
    reference = mean_pose(relative[still])
    turned = inverse(reference)[:3, :3] @ relative[still, :3, :3]
    stir = float(np.sqrt(np.mean(np.sum((turned - np.eye(3)) ** 2, axis=(1, 2))) / 2))
    if stir > UNSTEADY:
        raise InputError(
            f"{recording.source}: {name} moves by {np.rad2deg(stir):.1f} deg RMS in the first {settings.rest:g} s,"
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


def _lengths(joints: tuple[Joint, ...], segments: list[SegmentMotion], layout: Layout):
    """Phalanx lengths at rest [m] and 95 % half widths; the distal one is from the DIP to the tip marker."""
    lengths, intervals = [], []
    for near, far in pairwise(joints):
        carried = _carried(near)
        lengths.append(joint_length(carried, far.axis, np.zeros(3)))
        a, b, _ = joint_points(carried, far.axis, np.zeros(3))
        intervals.append(_half_width(b - a, near, far))
    a, b, normal = joint_points(_carried(joints[1]), joints[2].axis, np.zeros(3))
    along = (b - a) / np.linalg.norm(b - a)
    tip = segments[3].triad.shape[segments[3].triad.names.index(layout.tip)]
    reach = across(apply(joints[2].reference, tip[None])[0] - b, normal) @ along
    half = 1.96 * np.sqrt(along @ joints[2].line.covariance @ along)
    return (*lengths, float(reach)), (*intervals, float(half))


def _carried(joint: Joint) -> Axis:
    """Express the axis of a joint at rest in the frame of the segment distal to it."""
    to_distal = inverse(joint.reference)
    turn = to_distal[:3, :3]
    return Axis(turn @ joint.axis.direction, apply(to_distal, joint.axis.point[None])[0], turn @ joint.axis.slope)


def _half_width(way: np.ndarray, near: Joint, far: Joint) -> float:
    """95 % half width [m] of a length along `way`, from the covariances of the two intercepts in their own frames."""
    way = way / np.linalg.norm(way)
    turn = near.reference[:3, :3]
    variance = way @ turn.T @ near.line.covariance @ turn @ way + way @ far.line.covariance @ way
    return 1.96 * float(np.sqrt(variance))


def _back(values: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Scatter values of the seen frames among all frames, NaN elsewhere."""
    full = np.full((len(seen), *values.shape[1:]), np.nan)
    full[seen] = values
    return full
