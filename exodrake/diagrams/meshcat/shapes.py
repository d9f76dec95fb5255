"""Geometry of the drawing: bones, routers and pieces of tendons, and where they are at a posture.

World: x along the straight finger, z up on the dorsal side, the MCP joint in the origin; flexion turns about +y, so the
tip sinks. Frames are named by the segment they ride on: 0 the hand, i the phalanx distal to joint i.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.robot import Robot

PALMAR, DORSAL = -1.0, 1.0
# tendon -> (suffix of its router parameters, side, lateral position [m], joints that it passes; None: all)
ROUTES = {
    "AF": ("f", PALMAR, 0.0016, None),
    "MF": ("f", PALMAR, -0.0016, 1),
    "AE": ("e", DORSAL, 0.0, None),
}
HAND_END = -0.055  # [m] where the tendons leave the hand


@dataclass(frozen=True)
class Piece:
    """A straight piece of a tendon from `start` on segment `first` to `end` on segment `last`; points (3,) [m]."""

    tendon: str
    first: int
    start: np.ndarray
    last: int
    end: np.ndarray

    @property
    def name(self) -> str:
        """Name of the piece among those of its tendon."""
        return f"on_{self.first}" if self.first == self.last else f"over_{self.last}"


@dataclass(frozen=True)
class Skeleton:
    """lengths, radii (joints,) [m]; pieces of all tendons; routers: (segment, point (3,) [m]) each."""

    joints: tuple[str, ...]
    lengths: np.ndarray
    radii: np.ndarray
    pieces: tuple[Piece, ...]
    routers: tuple[tuple[int, np.ndarray], ...]


def route(robot: Robot, tendon: str) -> list[tuple[int, np.ndarray]]:
    """Routers of a tendon from the hand to its end: (segment, point (3,) [m]) each."""
    suffix, side, lateral, count = ROUTES[tendon]
    a, b, m, n = (robot.channels(f"router.{letter}_{suffix}") for letter in "abmn")
    lengths = np.concatenate([[0.0], robot.channels("finger.length")])
    points = []
    for i in range(count or len(a)):
        points.append((i, np.array([lengths[i] - b[i], lateral, side * m[i]])))
        points.append((i + 1, np.array([a[i], lateral, side * n[i]])))
    return points


def has_finger(robot: Robot) -> bool:
    """Whether the robot has a tendon-driven finger that can be drawn."""
    return set(ROUTES) >= set(robot.machine.axes.tendons) and "finger.length" in names_of(robot)


def skeleton(robot: Robot) -> Skeleton:
    """Bones, routers and tendons of a robot. InputError for a robot without finger, or a phalanx without size."""
    if not has_finger(robot):
        raise InputError(f"{robot.machine.name}: no tendon-driven finger to draw")
    for name in ("finger.length", "finger.radius"):
        if not (np.isfinite(robot.channels(name)) & (robot.channels(name) > 0)).all():
            raise InputError(f"{robot.source}: a {name} is not above 0, so there is no finger to draw")
    pieces, routers = [], []
    for tendon in robot.machine.axes.tendons:
        points = route(robot, tendon)
        routers += points
        parameter = np.array([HAND_END, *points[0][1][1:]])
        for (first, start), (last, end) in zip([(0, parameter), *points], points, strict=False):
            pieces.append(Piece(tendon, first, start, last, end))
    lengths, radii = robot.channels("finger.length"), robot.channels("finger.radius")
    return Skeleton(robot.machine.axes.joints, lengths, radii, tuple(pieces), tuple(routers))


def names_of(robot: Robot) -> set[str]:
    """Names of the robot's parameters, without channels."""
    return {parameter.name.rsplit(".", 1)[0] for parameter in robot.machine.parameters}


def turn(angle: float) -> np.ndarray:
    """Rotation (3, 3) by flexion [rad]."""
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
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return (start + end) / 2.0, np.column_stack([x, np.cross(z, x), z]), length


def tip(robot: Robot, angle: np.ndarray) -> np.ndarray:
    """Fingertip (3,) [m] in the world; angle (joints,) [rad]."""
    direction = np.cumsum(angle)
    lengths = robot.channels("finger.length")
    return np.array([lengths @ np.cos(direction), 0.0, -lengths @ np.sin(direction)])
