"""First guess of the bundle adjustment: every joint a hinge, from the poses of the triads.

The poses of the triads at rest place all markers and axes in the frame of the base triad. There the motion of a joint,
the relative motion of its two segments from that posture, gives axis, angle and centre in closed form (`axis`). The
abduction axis starts through the MCP centre, normal to flexion and to the finger.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from exodrake.core.errors import InputError
from exodrake.identification.kinematics.adjust import Finger
from exodrake.identification.kinematics.axis import (
    Axis,
    across,
    angle_about,
    apply,
    centres,
    inverse,
    mean_axis,
    weight,
)
from exodrake.identification.kinematics.markers import JOINTS, Recording
from exodrake.identification.kinematics.triads import SegmentMotion, mean_pose

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
        _refuse_still(name, angle, smallest, recording)
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


def _refuse_still(name: str, angle: np.ndarray, smallest: float, recording: Recording) -> None:
    """InputError for a joint that hardly moves."""
    beyond = np.count_nonzero(np.abs(angle) >= smallest)
    if beyond < FEWEST:
        most = np.rad2deg(np.nanmax(np.abs(angle)))
        raise InputError(
            f"{recording.source}: {name} turns {most:.1f} deg at most and is beyond"
            f" {np.rad2deg(smallest):.0f} deg in {beyond} frames; its centre needs {FEWEST} such frames"
        )


def _scarce(name: str, pair: list[SegmentMotion], seen: np.ndarray, recording: Recording) -> str:
    """Say which marker is missing most where a joint is unseen."""
    markers = [marker for segment in pair for marker in segment.triad.names]
    gone = np.isnan(recording.of(tuple(markers))).any(axis=2).mean(axis=0)
    worst = int(np.argmax(gone))
    why = f", marker {markers[worst]} being missing in {100 * gone[worst]:.0f} % of them" if gone[worst] > 0 else ""
    return f"{recording.source}: {name} is seen in {np.count_nonzero(seen)} of {len(seen)} frames{why}"
