"""Kinematic identification of the paper's 2.2.1: markers to joint axes, centres, angles, lengths and ranges.

Steps: check labels; fit the triads to smoothed paths for a first guess; adjust finger, poses and angles to the measured
markers of all frames together (`adjust`); read lengths and centre lines, with intervals, from the adjusted finger; and
fit its angles to the smoothed paths. Joint i is described in the frame of the triad proximal to it.
"""

from dataclasses import dataclass

import numpy as np

from exodrake.core.confidence import NORMAL_95
from exodrake.identification.kinematics.adjust import adjust, fit_frames
from exodrake.identification.kinematics.axis import Axis, across
from exodrake.identification.kinematics.centre_line import CentreLine
from exodrake.identification.kinematics.finger import Finger
from exodrake.identification.kinematics.first_guess import first_guess
from exodrake.identification.kinematics.hinge import centres
from exodrake.identification.kinematics.labels import check_labels, refuse_swaps
from exodrake.identification.kinematics.layout import JOINTS, Layout
from exodrake.identification.kinematics.markers import Recording
from exodrake.identification.kinematics.measures import measured
from exodrake.identification.kinematics.rigid import apply, inverse
from exodrake.identification.kinematics.smooth import smooth
from exodrake.identification.kinematics.triads import place, placed, triad_pose

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
