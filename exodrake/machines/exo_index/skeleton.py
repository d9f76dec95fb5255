"""The drawing of the Exo-Index: phalanges, routers and the wires of the tendons."""

from __future__ import annotations

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.core.skeleton import Piece, Skeleton

PALMAR, DORSAL = -1.0, 1.0
# tendon -> (suffix of its router parameters, side, lateral position [m], joints that it passes; None: all)
ROUTES = {
    "AF": ("f", PALMAR, 0.0016, None),
    "MF": ("f", PALMAR, -0.0016, 1),
    "AE": ("e", DORSAL, 0.0, None),
}
HAND_END = -0.055  # [m] where the tendons leave the hand


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


def skeleton(robot: Robot) -> Skeleton:
    """Bones, routers and tendons of a robot. InputError for a phalanx without size."""
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
    joints = robot.machine.axes.joints
    return Skeleton(joints, lengths, radii, HAND_END, tuple(pieces), tuple(routers), "angle", "tension")
