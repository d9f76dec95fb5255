"""Elements of a URDF file: bodies and joints, each checked when read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.schema import shown

MAX_BYTES = 4_000_000  # a hundred times a long one
TURNING, SLIDING = ("revolute", "continuous"), "prismatic"
LARGEST = 1e9  # of a length, mass, inertia or loss [SI]: beyond any arm
KINDS = (*TURNING, SLIDING, "fixed")


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
    """A joint of a URDF file.

    Attributes:
        name, kind, parent, child: as the file says.
        origin, angles, axis: (3,) [m], (3,) roll, pitch, yaw [rad], (3,) unit vector.
        lower, upper, effort: limits [rad] or [m], [N m] or [N]; infinite where there is none.
        damping, friction: of its `dynamics`.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: np.ndarray
    angles: np.ndarray
    axis: np.ndarray
    lower: float
    upper: float
    effort: float
    damping: float
    friction: float


def parsed(data: bytes, source: str) -> ElementTree.Element:
    """The `robot` element. InputError for what is no XML, is too long, or declares entities."""
    if len(data) > MAX_BYTES:
        raise InputError(f"{source}: {len(data)} bytes, more than {MAX_BYTES}")
    plain = data.replace(b"\0", b"").upper()  # UTF-16 would hide a declaration
    if b"<!DOCTYPE" in plain or b"<!ENTITY" in plain:
        raise InputError(f"{source}: declares a document type or entities, which a robot description does not need")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"{source}: not XML ({error})") from None
    if root.tag != "robot":
        raise InputError(f"{source}: begins with <{shown(root.tag)[1:-1]}>, wanted <robot>, a URDF file")
    if root.find("{*}macro") is not None or b"<XACRO:" in plain:
        raise InputError(f"{source}: holds xacro macros; expand them first: xacro {source} > arm.urdf")
    return root


def text_of(element: ElementTree.Element, name: str, source: str) -> str:
    """An attribute that must be there."""
    found = element.get(name)
    if not found:
        raise InputError(f"{source}: a <{element.tag}> without {name}")
    return found


def numbers(
    element: ElementTree.Element | None, name: str, default: Sequence[float], where: str, most: float = LARGEST
) -> np.ndarray:
    """Numbers of an attribute, none beyond any arm's, as many as the default has; the default without it."""
    text = None if element is None else element.get(name)
    if text is None:
        return np.array(default, dtype=float)
    try:
        found = np.array([float(word) for word in text.split()])
    except ValueError:
        found = np.zeros(0)
    if len(found) != len(default) or not np.isfinite(found).all():
        raise InputError(f"{where}: {name} is {shown(text)}, wanted {len(default)} number{'s' * (len(default) > 1)}")
    if np.abs(found).max() > most:
        raise InputError(f"{where}: {name} is {shown(text)}, beyond any arm's, {most:g}")
    return found


def rotation(angles: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) of roll, pitch, yaw (3,) [rad] about fixed axes."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles), np.sin(angles)
    return np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ])  # fmt: skip


def body_of(link: ElementTree.Element, source: str) -> Body:
    """Mass and inertia of a link; none where it states none."""
    inertial, where = link.find("inertial"), f"{source}: link {shown(link.get('name'))}"
    if inertial is None:
        return Body()
    origin, tensor = inertial.find("origin"), inertial.find("inertia")
    mass = float(numbers(inertial.find("mass"), "value", [0.0], where)[0])
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    xx, xy, xz, yy, yz, zz = (float(numbers(tensor, name, [0.0], where)[0]) for name in names)
    turn = rotation(numbers(origin, "rpy", [0.0] * 3, where))
    inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    if mass < 0.0 or np.linalg.eigvalsh(inertia)[0] < -1e-9 * max(1e-9, float(np.abs(inertia).max())):
        raise InputError(f"{where}: mass {mass:g} kg and inertia are those of no body")
    return Body(mass, numbers(origin, "xyz", [0.0] * 3, where), inertia)


def joint_of(element: ElementTree.Element, source: str) -> Joint:
    """A joint. InputError for a kind that an arm does not have."""
    name = text_of(element, "name", source)
    kind, where = text_of(element, "type", source), f"{source}: joint {name}"
    if kind not in KINDS:
        raise InputError(f"{where} is {shown(kind)}, wanted {', '.join(KINDS)}")
    if element.find("mimic") is not None:
        raise InputError(f"{where} mimics another one, which is not modelled")
    parent, child = (element.find(end) for end in ("parent", "child"))
    if parent is None or child is None:
        raise InputError(f"{where} lacks its parent or child link")
    origin, limit, dynamics = (element.find(tag) for tag in ("origin", "limit", "dynamics"))
    axis = numbers(element.find("axis"), "xyz", [1.0, 0.0, 0.0], where)
    if kind != "fixed" and not np.linalg.norm(axis) > 0.0:
        raise InputError(f"{where}: its axis has no length")
    free = (-math.inf, math.inf) if kind == "continuous" or limit is None else (0.0, 0.0)
    given = [free[0], free[1], math.inf]
    stated = zip(("lower", "upper", "effort"), given, strict=True)
    ends = [numbers(limit, n, [d], where, math.inf)[0] for n, d in stated]
    ends = [end if abs(end) < LARGEST else math.copysign(math.inf, end) for end in ends]  # as some programs write none
    if ends[0] > ends[1] or ends[0] == math.inf or ends[1] == -math.inf:
        raise InputError(f"{where}: its lower limit {ends[0]:g} exceeds its upper one {ends[1]:g}")
    losses = [float(numbers(dynamics, n, [0.0], where)[0]) for n in ("damping", "friction")]
    return Joint(
        name, kind, text_of(parent, "link", source), text_of(child, "link", source),
        numbers(origin, "xyz", [0.0] * 3, where), numbers(origin, "rpy", [0.0] * 3, where),
        axis / (np.linalg.norm(axis) or 1.0), *(float(end) for end in ends), *losses,
    )  # fmt: skip
