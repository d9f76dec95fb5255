"""Serial arms from URDF files: joints, link inertias and limits; meshes are not read.

The file is data of somebody else: its size is limited, and document types and entities are refused, so that nothing is
expanded or fetched. Drake's parser reads the same values (`tests/test_arm_urdf.py`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError, nearest
from exodrake.core.files import read_bytes
from exodrake.machines.urdf_elements import SLIDING, Body, Joint, body_of, joint_of, parsed, rotation, text_of

MAX_JOINTS, MAX_ALL = 30, 300  # that move on the way to the tip; in the file


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
        return np.array([float(joint.kind == SLIDING) for joint in self.joints])


def read_urdf(path: str | Path, tip: str = "") -> Chain:
    """The arm of a URDF file.

    Args:
        path: of the file.
        tip: link at which the arm ends; needed where the moving joints branch. Joints elsewhere stand at 0.

    Raises:
        InputError: naming file and what is wrong.
    """
    source = Path(path).name
    root = parsed(read_bytes(path), source)
    bodies = {text_of(link, "name", source): body_of(link, source) for link in root.findall("link")}
    joints = [joint_of(element, source) for element in root.findall("joint")]
    if len(joints) > MAX_ALL:
        raise InputError(f"{source}: {len(joints)} joints, more than {MAX_ALL}")
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in bodies:
                raise InputError(f"{source}: joint {joint.name} names a link {link!r} that is not there")
    by_child = {joint.child: joint for joint in joints}
    if len(by_child) < len(joints):
        raise InputError(f"{source}: a link hangs on two joints, so this is no serial arm")
    path_ = way_to(end_of(joints, bodies, tip, source), by_child, source)
    return chain_of(path_, joints, bodies, source)


def end_of(joints: Sequence[Joint], bodies: Mapping[str, Body], tip: str, source: str) -> str:
    """The link at which the arm ends. InputError where there are several, naming them."""
    if tip:
        if tip not in bodies:
            raise InputError(f"{source}: no link {tip!r}{nearest(tip, list(bodies))}")
        return tip
    moving, parents = [j for j in joints if j.kind != "fixed"], {j.child: j for j in joints}

    def moved(link: str) -> tuple[str, ...]:
        path = way_to(link, parents, source)
        return tuple(joint.name for joint in path if joint.kind != "fixed")

    leaves = [link for link in bodies if all(joint.parent != link for joint in joints)]
    whole = [link for link in leaves if len(moved(link)) == len(moving)]
    if not moving or not leaves:
        raise InputError(f"{source}: no joint moves, so there is no arm")
    if not whole:
        raise InputError(f"{source}: its moving joints branch; name the last link, `tip`: {', '.join(leaves[:8])}")
    return max(whole, key=lambda link: len(way_to(link, parents, source)))


def way_to(link: str, by_child: Mapping[str, Joint], source: str) -> list[Joint]:
    """Joints from the base to a link. InputError for a ring."""
    found: list[Joint] = []
    while link in by_child:
        found.append(by_child[link])
        link = found[-1].parent
        if len(found) > len(by_child):
            raise InputError(f"{source}: its links form a ring")
    return found[::-1]


def chain_of(path: Sequence[Joint], joints: Sequence[Joint], bodies: Mapping[str, Body], source: str) -> Chain:
    """The arm along a path of joints; what hangs on its links moves with them."""
    moving = [joint for joint in path if joint.kind != "fixed"]
    if not 0 < len(moving) <= MAX_JOINTS:
        raise InputError(f"{source}: {len(moving)} moving joints on the way to the tip, wanted 1 to {MAX_JOINTS}")
    on_way = {joint.name for joint in moving}

    def whole(link: str, depth: int = 0) -> Body:
        """A link and all that hangs on it, but for what the arm's next joint moves."""
        if depth > len(bodies):
            raise InputError(f"{source}: its links form a ring")
        found = bodies[link]
        for joint in (j for j in joints if j.parent == link and j.name not in on_way):
            found = found.joined(whole(joint.child, depth + 1), rotation(joint.angles), joint.origin)
        return found

    turn, point, placed, direct = np.eye(3), np.zeros(3), [], True
    for joint in path:
        point, turn = point + turn @ joint.origin, turn @ rotation(joint.angles)
        if joint.kind != "fixed":
            angles = joint.angles if direct else angles_of(turn)
            placed.append(replace(joint, origin=point, angles=angles))
            turn, point = np.eye(3), np.zeros(3)
        direct = joint.kind != "fixed"
    carried = tuple(whole(joint.child) for joint in moving)
    if not carried[-1].mass > 0.0:
        raise InputError(f"{source}: link {moving[-1].child}, which the last joint moves, has no mass")
    return Chain(channel_names([joint.name for joint in moving], source), tuple(placed), carried, point)


def angles_of(turn: np.ndarray) -> np.ndarray:
    """Roll, pitch, yaw (3,) [rad] of a rotation (3, 3)."""
    flat = math.hypot(turn[0, 0], turn[1, 0])
    pitch = math.atan2(-turn[2, 0], flat)
    if flat > 1e-9:
        return np.array([math.atan2(turn[2, 1], turn[2, 2]), pitch, math.atan2(turn[1, 0], turn[0, 0])])
    return np.array([math.atan2(-turn[1, 2], turn[1, 1]), pitch, 0.0])


def channel_names(names: Sequence[str], source: str) -> tuple[str, ...]:
    """Names of joints as log columns have them: letters and digits. InputError where two become one."""
    found = tuple(re.sub(r"[^A-Za-z0-9]", "", name) for name in names)
    found = tuple(name if name[:1].isalpha() else f"J{name}" for name in found)
    if len(set(found)) < len(found):
        raise InputError(f"{source}: names of joints differ only in signs: {', '.join(names)}")
    return found
