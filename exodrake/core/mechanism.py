"""A robot as rigid-body simulators take it: bodies, joints, drives and tendons."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np

GRAVITY = 9.81  # m/s2, as Drake has it


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body in the frame of a link: mass [kg], centre (3,) [m], inertia about the centre (3, 3) [kg m2]."""

    mass: float = 0.0
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))
    inertia: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))

    def joined(self, other: Body, rotation: np.ndarray, origin: np.ndarray) -> Body:
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
    """A joint as URDF has it.

    Attributes:
        name, kind, parent, child: as the file says; kind: revolute, continuous, prismatic or fixed.
        origin, angles, axis: (3,) [m], (3,) roll, pitch, yaw [rad], (3,) unit vector.
        lower, upper, effort: limits [rad] or [m], [N m] or [N]; infinite where there is none.
        damping, friction: viscous [N m s/rad] or [N s/m], dry [N m] or [N].
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: np.ndarray
    angles: np.ndarray
    axis: np.ndarray
    lower: float = -inf
    upper: float = inf
    effort: float = inf
    damping: float = 0.0
    friction: float = 0.0


@dataclass(frozen=True, eq=False)
class Chain:
    """A serial arm: its moving joints from the base to the tip, and the body that each moves.

    Attributes:
        names: of the joints, letters and digits alone, as log columns have them.
        joints: in the same order; `origin` and `angles` are those in the frame of the moving joint before.
        bodies: of the links, with all that is fixed to them.
        tip: (3,) [m] where the tool is, in the frame of the last joint.
    """

    names: tuple[str, ...]
    joints: tuple[Joint, ...]
    bodies: tuple[Body, ...]
    tip: np.ndarray

    @property
    def sliding(self) -> np.ndarray:
        """(joints,) 1 for a prismatic joint, else 0."""
        return np.array([float(joint.kind == "prismatic") for joint in self.joints])


@dataclass(frozen=True)
class Drive:
    """The position loop of a joint, and what lies between motor and link; a joint that slides has m for rad.

        effort = kp (gain command + offset - q) - kv q'          within the joint's limit of effort

    Attributes:
        kp, kv: gains [N m/rad], [N m s/rad]; no position loop if both are 0.
        gain, offset: joint over command [-], angle at command 0 [rad].
        delay, lag: dead time and time constant of a first-order lag of the command [s].
        gravity: share of the link's weight that the controller bears [-].
        speed: limit [rad/s].
        armature: inertia of the rotor as the joint feels it [kg m2].
        compliance: between rotor and link [rad/(N m)].
        backlash: half its width, between rotor and link [rad].
        spring, rest: stiffness of a passive joint [N m/rad], and where it rests [rad].
    """

    kp: float = 0.0
    kv: float = 0.0
    gain: float = 1.0
    offset: float = 0.0
    delay: float = 0.0
    lag: float = 0.0
    gravity: float = 0.0
    speed: float = inf
    armature: float = 0.0
    compliance: float = 0.0
    backlash: float = 0.0
    spring: float = 0.0
    rest: float = 0.0


@dataclass(frozen=True, eq=False)
class Tendon:
    """An elastic tendon that a motor winds in at a commanded speed, and that pulls only.

    Attributes:
        name: of the tendon.
        points: what it runs through: (link, point (3,) [m]); link 0 is the base, link i the one that joint i moves.
        stiffness, damping, friction: [N/m], [N s/m], [N].
        limit: largest tension [N].
        delay: of the command [s].
    """

    name: str
    points: tuple[tuple[int, np.ndarray], ...]
    stiffness: float
    damping: float = 0.0
    friction: float = 0.0
    limit: float = inf
    delay: float = 0.0


@dataclass(frozen=True, eq=False)
class Mechanism:
    """What another simulator needs of a robot.

    Attributes:
        chain: joints and links.
        drives: one a joint.
        step: with which the robot is well simulated [s].
        stated: ids of the effects that chain, drives and tendons state.
        tendons: that move the joints, if any.
        payload, borne: mass at the tip [kg], and the share of its weight that the controller bears.
        radii: (joints,) of the links, to draw them [m].
        tilt: (2,) roll and pitch of the base [rad].
        gravity: [m/s2].
        beside: whether each joint stands on the base, and not on the one before.
        notes: sentences about what is assumed or left out.
    """

    chain: Chain
    drives: tuple[Drive, ...]
    step: float
    stated: frozenset[str]
    tendons: tuple[Tendon, ...] = ()
    payload: float = 0.0
    borne: float = 0.0
    radii: np.ndarray | None = None
    tilt: tuple[float, float] = (0.0, 0.0)
    gravity: float = GRAVITY
    beside: bool = False
    notes: tuple[str, ...] = ()
