"""Geometry of a robot: bodies, joints, drives and tendons for rigid-body simulators, and what a recording draws.

A finger is drawn as a `Skeleton`: segments that turn about joints one after the other, and tendons along them. World: x
along the straight robot, z up, the first joint in the origin; a positive angle turns about +y, so the tip sinks. Frames
are named by the segment they ride on: 0 the base, i the segment distal to joint i. An arm is drawn as a `Shape`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body in the frame of a link: mass [kg], centre (3,) [m], inertia about the centre (3, 3) [kg m2]."""

    mass: float = 0.0
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))

    def join(self, other: Body, rotation: np.ndarray, origin: np.ndarray) -> Body:
        """This body and another one whose frame stands at `origin` (3,) [m], turned by `rotation` (3, 3)."""
        mass = self.mass + other.mass
        if not mass:
            return self
        place = origin + rotation @ other.centre
        centre = (self.mass * self.centre + other.mass * place) / mass
        inertia = self.inertia + rotation @ other.inertia @ rotation.T
        for m, at in ((self.mass, self.centre - centre), (other.mass, place - centre)):
            inertia = inertia + m * (at @ at * np.eye(3) - np.outer(at, at))
        return Body(mass, centre, inertia)


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint as URDF has it."""

    name: str
    kind: str  # revolute, continuous, prismatic or fixed
    parent: str
    child: str
    origin: np.ndarray  # (3,) [m]
    angles: np.ndarray  # (3,) roll, pitch, yaw [rad]
    axis: np.ndarray  # (3,) unit vector
    lower: float = -inf  # limit [rad] or [m]
    upper: float = inf
    effort: float = inf  # limit [N m] or [N]
    damping: float = 0.0  # viscous [N m s/rad] or [N s/m]
    friction: float = 0.0  # dry [N m] or [N]


@dataclass(frozen=True, eq=False)
class Chain:
    """A serial arm: its moving joints from the base to the tip, and the body that each moves."""

    names: tuple[str, ...]  # of the joints, letters and digits alone, as log columns have them
    joints: tuple[Joint, ...]  # `origin` and `angles` in the frame of the moving joint before
    bodies: tuple[Body, ...]  # of the links, with all that is fixed to them
    tip: np.ndarray  # (3,) [m] where the tool is, in the frame of the last joint

    @property
    def sliding(self) -> np.ndarray:
        """(joints,) 1 for a prismatic joint, else 0."""
        return np.array([float(joint.kind == "prismatic") for joint in self.joints])


@dataclass(frozen=True)
class Drive:
    """The position loop of a joint, and what lies between motor and link; a joint that slides has m for rad.

    effort = kp (gain command + offset - q) - kv q'          within the joint's limit of effort
    """

    kp: float = 0.0  # gain [N m/rad]; no position loop if kv is 0, too
    kv: float = 0.0  # gain [N m s/rad]
    gain: float = 1.0  # joint over command [-]
    offset: float = 0.0  # angle at command 0 [rad]
    delay: float = 0.0  # dead time of the command [s]
    lag: float = 0.0  # time constant of a first-order lag of the command [s]
    gravity: float = 0.0  # share of the link's weight that the controller bears [-]
    speed: float = inf  # limit [rad/s]
    armature: float = 0.0  # inertia of the rotor as the joint feels it [kg m2]
    compliance: float = 0.0  # between rotor and link [rad/(N m)]
    backlash: float = 0.0  # half its width, between rotor and link [rad]
    spring: float = 0.0  # stiffness of a passive joint [N m/rad]
    rest: float = 0.0  # where a passive joint rests [rad]


@dataclass(frozen=True, eq=False)
class Tendon:
    """An elastic tendon that a motor winds in at a commanded speed, and that pulls only."""

    name: str
    points: tuple[tuple[int, np.ndarray], ...]  # on its way: (link, point (3,) [m]); 0 the base, i moved by joint i
    stiffness: float  # [N/m]
    damping: float = 0.0  # [N s/m]
    friction: float = 0.0  # [N]
    limit: float = inf  # largest tension [N]
    delay: float = 0.0  # of the command [s]


@dataclass(frozen=True, eq=False)
class Mechanism:
    """What another simulator needs of a robot."""

    chain: Chain  # joints and links
    drives: tuple[Drive, ...]  # one a joint
    step: float  # with which the robot is well simulated [s]
    stated: frozenset[str]  # ids of the effects that chain, drives and tendons state
    tendons: tuple[Tendon, ...] = ()  # that move the joints, if any
    payload: float = 0.0  # mass at the tip [kg]
    borne: float = 0.0  # share of the payload's weight that the controller bears [-]
    radii: np.ndarray | None = None  # (joints,) of the links, to draw them [m]
    tilt: tuple[float, float] = (0.0, 0.0)  # (2,) roll and pitch of the base [rad]
    gravity: float = 0.0  # [m/s2]
    beside: bool = False  # whether each joint stands on the base, and not on the one before
    notes: tuple[str, ...] = ()  # sentences about what is assumed or left out


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


@dataclass(frozen=True)
class Shape:
    """Geometry of a serial arm in space, or of axes side by side, and the columns that move and colour it."""

    joints: tuple[str, ...]  # their names, from the base to the tip
    origins: np.ndarray  # (joints, 3) in the frame of the joint before [m]
    angles: np.ndarray  # (joints, 3) roll, pitch, yaw in that frame [rad]
    axes: np.ndarray  # (joints, 3) unit vectors
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
