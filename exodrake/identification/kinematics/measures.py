"""Lengths and centre lines of a finger, and their covariance from that of the bundle adjustment."""

import numpy as np

from exodrake.identification.kinematics.adjust import Adjusted
from exodrake.identification.kinematics.axis import across, joint_points
from exodrake.identification.kinematics.finger import Finger
from exodrake.identification.kinematics.triads import triad_pose

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
