"""Where the parts of a drawn robot are at a posture."""

from __future__ import annotations

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.core.skeleton import Piece, Shape, Skeleton


def skeleton(robot: Robot) -> Skeleton | Shape:
    """Segments and tendons of a robot, or an arm. InputError where there is none, or a part has no size."""
    if robot.machine.skeleton is None:
        raise InputError(f"{robot.machine.name}: nothing to draw, since its machine.py says nothing of its shape")
    return robot.machine.skeleton(robot)


def finger_skeleton(robot: Robot) -> Skeleton:
    """`skeleton` of a finger. InputError for a machine that has none."""
    found = skeleton(robot)
    if isinstance(found, Shape):
        raise InputError(f"{robot.machine.name}: nothing to draw, since it has no finger")
    return found


def turn(angle: float) -> np.ndarray:
    """Rotation (3, 3) [-] by a joint's angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def span(bones: Skeleton, piece: Piece, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends (3,), (3,) [m] of a piece in the frame of its first segment; angle (joints,) [rad]."""
    if piece.first == piece.last:
        return piece.start, piece.end
    joint = np.array([bones.lengths[piece.first - 1] if piece.first else 0.0, 0.0, 0.0])
    return piece.start, joint + turn(angle[piece.first]) @ piece.end


def along(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Middle (3,) [m], rotation (3, 3) that takes z to start -> end, and length [m]."""
    length = float(np.linalg.norm(end - start))
    z = (end - start) / length
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return (start + end) / 2.0, np.column_stack([x, np.cross(z, x), z]), length
