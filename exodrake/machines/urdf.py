"""Serial arms from URDF files: joints, link inertias and limits, each checked when read; meshes are not read.

The file is data of somebody else: its size is limited, and document types and entities are refused, so that nothing is
expanded or fetched. Drake's parser reads the same values (`tests/test_arm.py`).
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from exodrake.core.errors import InputError, nearest
from exodrake.core.files import read_bytes
from exodrake.core.schema import quote
from exodrake.model.mechanism import Body, Chain, Joint
from exodrake.physics.arm import roll_pitch_yaw

MAX_BYTES = 4_000_000  # a hundred times a long one
LARGEST = 1e9  # of a length, mass, inertia or loss [SI]: beyond any arm
KINDS = ("revolute", "continuous", "prismatic", "fixed")


def read_attribute(element: ElementTree.Element, name: str, source: str) -> str:
    """An attribute that must be there."""
    if not (found := element.get(name)):
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
        raise InputError(f"{where}: {name} is {quote(text)}, wanted {len(default)} number{'s' * (len(default) > 1)}")
    if np.abs(found).max() > most:
        raise InputError(f"{where}: {name} is {quote(text)}, beyond any arm's, {most:g}")
    return found


def rotation(angles: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) of roll, pitch, yaw (3,) [rad] about fixed axes."""
    return np.reshape(roll_pitch_yaw(*angles), (3, 3))


def read_body(link: ElementTree.Element, source: str) -> Body:
    """Mass and inertia of a link; none where it states none."""
    inertial, where = link.find("inertial"), f"{source}: link {quote(link.get('name'))}"
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


def read_joint(element: ElementTree.Element, source: str) -> Joint:
    """A joint. InputError for a kind that an arm does not have."""
    name = read_attribute(element, "name", source)
    kind, where = read_attribute(element, "type", source), f"{source}: joint {name}"
    if kind not in KINDS:
        raise InputError(f"{where} is {quote(kind)}, wanted {', '.join(KINDS)}")
    if element.find("mimic") is not None:
        raise InputError(f"{where} mimics another one, which is not modelled")
    parent, child = (element.find(end) for end in ("parent", "child"))
    if parent is None or child is None:
        raise InputError(f"{where} lacks its parent or child link")
    origin, limit, dynamics = (element.find(tag) for tag in ("origin", "limit", "dynamics"))
    axis = numbers(element.find("axis"), "xyz", [1.0, 0.0, 0.0], where)
    if kind != "fixed" and not np.linalg.norm(axis) > 0.0:
        raise InputError(f"{where}: its axis has no length")
    free = math.inf if kind == "continuous" or limit is None else 0.0
    stated = {"lower": -free, "upper": free, "effort": math.inf}
    ends = [numbers(limit, n, [d], where, math.inf)[0] for n, d in stated.items()]
    ends = [end if abs(end) < LARGEST else math.copysign(math.inf, end) for end in ends]  # as some programs write none
    if ends[0] > ends[1] or ends[0] == math.inf or ends[1] == -math.inf:
        raise InputError(f"{where}: its lower limit {ends[0]:g} exceeds its upper one {ends[1]:g}")
    losses = [float(numbers(dynamics, n, [0.0], where)[0]) for n in ("damping", "friction")]
    return Joint(
        name, kind, read_attribute(parent, "link", source), read_attribute(child, "link", source),
        numbers(origin, "xyz", [0.0] * 3, where), numbers(origin, "rpy", [0.0] * 3, where),
        axis / (np.linalg.norm(axis) or 1.0), *(float(end) for end in ends), *losses,
    )  # fmt: skip


MAX_JOINTS, MAX_ALL = 30, 300  # that move on the way to the tip; in the file


def read_urdf(path: str | Path, tip: str = "") -> Chain:
    """The arm of a URDF file up to the link `tip`, which is needed where moving joints branch; others stand at 0."""
    source = Path(path).name
    data = read_bytes(path)
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
        raise InputError(f"{source}: begins with <{quote(root.tag)[1:-1]}>, wanted <robot>, a URDF file")
    if root.find("{*}macro") is not None or b"<XACRO:" in plain:
        raise InputError(f"{source}: holds xacro macros; expand them first: xacro {source} > arm.urdf")
    bodies = {read_attribute(link, "name", source): read_body(link, source) for link in root.findall("link")}
    joints = [read_joint(element, source) for element in root.findall("joint")]
    if len(joints) > MAX_ALL:
        raise InputError(f"{source}: {len(joints)} joints, more than {MAX_ALL}")
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in bodies:
                raise InputError(f"{source}: joint {joint.name} names a link {link!r} that is not there")
    by_child = {joint.child: joint for joint in joints}
    if len(by_child) < len(joints):
        raise InputError(f"{source}: a link hangs on two joints, so this is no serial arm")
    if tip and tip not in bodies:
        raise InputError(f"{source}: no link {tip!r}{nearest(tip, list(bodies))}")
    count = sum(joint.kind != "fixed" for joint in joints)
    leaves = [link for link in bodies if all(joint.parent != link for joint in joints)]
    if not tip and not (count and leaves):
        raise InputError(f"{source}: no joint moves, so there is no arm")
    whole = []  # ways from the base to the tip, or to each leaf
    for link in [tip] if tip else leaves:
        way: list[Joint] = []
        while link in by_child:
            way.insert(0, by_child[link])
            link = way[0].parent
            if len(way) > len(by_child):
                raise InputError(f"{source}: its links form a ring")
        whole += [way] if tip or sum(joint.kind != "fixed" for joint in way) == count else []
    if not whole:
        raise InputError(f"{source}: its moving joints branch; name the last link, `tip`: {', '.join(leaves[:8])}")
    return make_chain(max(whole, key=len), joints, bodies, source)


def make_chain(path: Sequence[Joint], joints: Sequence[Joint], bodies: Mapping[str, Body], source: str) -> Chain:
    """The arm along a path of joints; what hangs on its links moves with them."""
    moving = [joint for joint in path if joint.kind != "fixed"]
    if not 0 < len(moving) <= MAX_JOINTS:
        raise InputError(f"{source}: {len(moving)} moving joints on the way to the tip, wanted 1 to {MAX_JOINTS}")
    on_way = {joint.name for joint in moving}

    def whole(link: str) -> Body:
        """A link and all that hangs on it, but for what the arm's next joint moves."""
        found = bodies[link]
        for joint in (j for j in joints if j.parent == link and j.name not in on_way):
            found = found.join(whole(joint.child), rotation(joint.angles), joint.origin)
        return found

    turn, point, placed, direct = np.eye(3), np.zeros(3), [], True
    for joint in path:
        point, turn = point + turn @ joint.origin, turn @ rotation(joint.angles)
        if joint.kind != "fixed":
            angles = joint.angles
            if not direct:  # roll, pitch, yaw of the turn
                flat = math.hypot(turn[0, 0], turn[1, 0])
                sines = (turn[2, 1], turn[2, 2], turn[1, 0], turn[0, 0])
                roll, full, yaw, level = sines if flat > 1e-9 else (-turn[1, 2], turn[1, 1], 0.0, 1.0)
                angles = np.array([math.atan2(roll, full), math.atan2(-turn[2, 0], flat), math.atan2(yaw, level)])
            placed.append(replace(joint, origin=point, angles=angles))
            turn, point = np.eye(3), np.zeros(3)
        direct = joint.kind != "fixed"
    carried = tuple(whole(joint.child) for joint in moving)
    if not carried[-1].mass > 0.0:
        raise InputError(f"{source}: link {moving[-1].child}, which the last joint moves, has no mass")
    names = [re.sub(r"[^A-Za-z0-9]", "", joint.name) for joint in moving]  # as log columns have them
    names = tuple(name if name[:1].isalpha() else f"J{name}" for name in names)
    if len(set(names)) < len(names):
        listed = ", ".join(joint.name for joint in moving)
        raise InputError(f"{source}: names of joints differ only in signs: {listed}")
    return Chain(names, tuple(placed), carried, point)
