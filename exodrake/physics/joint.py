"""Ideal position servos without dynamics: joints behind a cable, a sheath or a gear follow the command at once.

    aim_j = ratio command_j          angle_j <- aim_j

What the model leaves out sits where a joint aims, how it follows, and what its neighbours do to it.
"""

import sys
from typing import Annotated, NamedTuple

from exodrake.model.part import JOINTS, SCALAR, FreeLaw, Output, Part, Point, State, Task, Unit, free_memory


class Parameters(NamedTuple):
    """How far a joint goes for its command, as its maker says."""

    ratio: Annotated[tuple, Unit("-", JOINTS)]


def aimed(e, z, j, aim, ahead, behind, setting):
    """Point: angle that the drive aims at [rad], from the command.

    ahead, behind: commands of the next and the previous joint, 0 at the ends; setting: of this joint [rad].
    """
    return aim


def followed(e, z, j, aim, before, dt, setting):
    """Point: angle after the tick [rad], from the aim; before: angle so far [rad]."""
    return aim


def shown(e, z, j, angle):
    """Point: angle at the joint [rad], from that of its drive."""
    return angle


def settle(e, z, j, dt, moved, ahead, behind, setting):
    """Point: states of the effects on joint j advance.

    moved: how far its aim moved in this tick [rad], first from where the joint stands; ahead, behind: those of the next
    and the previous joint, 0 at the ends; setting: of this joint [rad].
    """


def other(values, first, k, count):
    """The k-th of `count` values from `first` on, 0 beyond the ends."""
    return values[first + k] if 0 <= k < count else 0.0


def update(x, z, n, e, dt, command, origin, setting, ready):
    """One tick; signals [rad]. x: angles, aims, their moves, started. First the joints stand where the log starts."""
    count = command.shape[0]
    if ready[0] > 0.0:
        first = x[3 * count] == 0.0
        for j in range(count):
            after, before = other(command, 0, j + 1, count), other(command, 0, j - 1, count)
            aim = aimed(e, z, j, n.ratio[j] * command[j], after, before, setting[j])
            x[2 * count + j] = 0.0 if first else aim - x[count + j]
            x[count + j] = aim
            if first:
                x[j] = origin[j]
        for j in range(count):
            ahead, behind = other(x, 2 * count, j + 1, count), other(x, 2 * count, j - 1, count)
            moved = x[count + j] - x[j] if first else x[2 * count + j]
            settle(e, z, j, dt, moved, ahead, behind, setting[j])
            x[j] = followed(e, z, j, x[count + j], x[j], dt, setting[j])
        x[3 * count] = 1.0


def output(x, z, n, e, angle):
    """Angles [rad]."""
    for j in range(angle.shape[0]):
        angle[j] = shown(e, z, j, x[j])


FREE_LAWS = {
    "aimed": (
        FreeLaw("angle over command", "aim", "rad"),
        FreeLaw("angle over command of the next joint", "ahead", "rad"),
        FreeLaw("angle over command of the previous joint", "behind", "rad"),
        FreeLaw("gain over setting", "setting", "rad", "aim"),
    ),
    "followed": free_memory("of angle over command", "moved", "rad", "settle", moves=True),
    "shown": (
        *free_memory("of angle over command of the next joint", "ahead", "rad", "settle", moves=True),
        *free_memory("of angle over command of the previous joint", "behind", "rad", "settle", moves=True),
    ),
    "settle": (),
}

PART = Part(
    name="joint", module=sys.modules[__name__], parameters=Parameters,
    states=(
        State("angle", JOINTS, unit="rad"), State("aim", JOINTS, unit="rad"), State("moved", JOINTS, unit="rad"),
        State("started", SCALAR),
    ),
    tasks=(Task("update", ("command", "origin", "setting", "ready")),), outputs=(Output("output", ("angle",)),),
    points=tuple(Point(p, JOINTS, laws=laws) for p, laws in FREE_LAWS.items()),
)  # fmt: skip
