"""What a recording draws of a robot: segments that turn about joints one after the other, and tendons along them.

World: x along the straight robot, z up, the first joint in the origin; a positive angle turns about +y, so the tip
sinks. Frames are named by the segment they ride on: 0 the base, i the segment distal to joint i.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


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
    """Geometry of a drawing, and the columns that move and colour it."""

    joints: tuple[str, ...]  # their names, from the base to the tip
    lengths: np.ndarray  # (joints,) of the segments [m]
    radii: np.ndarray  # (joints,) of the skin round them [m]
    base: float  # x at which the base ends [m], below 0
    pieces: tuple[Piece, ...]  # of all tendons
    guides: tuple[tuple[int, np.ndarray], ...]  # what the tendons run through: (segment, point (3,) [m]) each
    angle: str  # kind of the columns with joint angles
    load: str  # kind of the columns that colour the tendons

    def carriers(self, segment: int) -> tuple[str, ...]:
        """Joints that carry a segment, from the base on."""
        return self.joints[:segment]

    @property
    def tendons(self) -> tuple[str, ...]:
        """Names of the tendons, in the order of their pieces."""
        return tuple(dict.fromkeys(piece.tendon for piece in self.pieces))

    def tip(self, angle: np.ndarray) -> np.ndarray:
        """End of the last segment (3,) [m]; angle (joints,) [rad]."""
        direction = np.cumsum(angle)
        return np.array([self.lengths @ np.cos(direction), 0.0, -self.lengths @ np.sin(direction)])


@dataclass(frozen=True)
class Shape:
    """Geometry of a serial arm in space, or of axes side by side, and the columns that move and colour it.

    World: axes of the base.
    """

    joints: tuple[str, ...]  # their names, from the base to the tip
    # origins, angles, axes: (joints, 3) of each joint in the frame of the one before: place [m], roll, pitch, yaw
    # [rad], unit vector
    origins: np.ndarray
    angles: np.ndarray
    axes: np.ndarray
    sliding: np.ndarray  # (joints,) 1 for a prismatic joint, else 0
    ends: np.ndarray  # (joints, 3) where what each joint moves ends, in its frame [m]
    tilt: np.ndarray  # (2,) roll and pitch of the base [rad]
    angle: str  # kind of the columns with joint positions
    load: str  # kind of the columns that colour the joints
    beside: bool = False  # each joint stands on the base, and not on the one before

    def carriers(self, segment: int) -> tuple[str, ...]:
        """Joints that carry a segment, from the base on."""
        return self.joints[segment - 1 : segment] if self.beside and segment else self.joints[:segment]

    @property
    def reach(self) -> float:
        """Largest distance that the arm reaches, or width over all axes [m]."""
        spans = np.linalg.norm(self.origins, axis=1)
        lengths = np.linalg.norm(self.ends, axis=1)
        return float(np.ptp(self.origins, axis=0).max() + lengths.max() if self.beside else spans.sum() + lengths[-1])

    @property
    def tendons(self) -> tuple[str, ...]:
        """Names of what is coloured by its load: the joints."""
        return self.joints


SPACING, POINTER = 0.2, 0.08  # m between axes side by side, and of the pointer of a turning one: assumed


def axes_side_by_side(joints: tuple[str, ...], angle: str, load: str, axis: str = "z", sliding: bool = False) -> Shape:
    """Axes of which no more is known than that they turn or slide; angle, load: kinds of columns as in `Shape`."""
    n = len(joints)
    row = np.zeros((n, 3))
    row[:, 1] = SPACING * (0.5 * (n - 1) - np.arange(n))
    lines = np.tile([float(axis == name) for name in "xyz"], (n, 1))
    ends = np.tile([0.0 if sliding else POINTER, 0.0, 0.0], (n, 1))
    return Shape(
        joints, row, np.zeros((n, 3)), lines, np.full(n, float(sliding)), ends, np.zeros(2), angle, load, beside=True
    )
