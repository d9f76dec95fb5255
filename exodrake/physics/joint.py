"""Ideal position servos without dynamics: joints behind a cable, a sheath or a gear follow the command at once.

    aim_j = ratio command_j          angle_j <- aim_j

What the model leaves out sits where a joint aims, how it follows, and what its neighbours do to it.
"""

import sys

from exodrake.model.part import JOINTS, SCALAR, FreeLaw, Output, Part, Point, State, Task, free_memory, parameter_class

Parameters = parameter_class((JOINTS, {"ratio": "-"}))  # how far a joint goes for its command, as its maker says

aim_joint = Point(
    "aimed", JOINTS, "aim, ahead, behind, setting",
    "angle that the drive aims at [rad], from the command; ahead, behind: commands of the next and the previous joint, "
    "0 at the ends; setting: of this joint [rad]",
    laws=(
        FreeLaw("angle over command", "aim", "rad"),
        FreeLaw("angle over command of the next joint", "ahead", "rad"),
        FreeLaw("angle over command of the previous joint", "behind", "rad"),
        FreeLaw("gain over setting", "setting", "rad", "aim"),
    ),
)  # fmt: skip
follow_aim = Point(
    "followed", JOINTS, "aim, before, dt, setting", "angle after the tick [rad], from the aim; before: so far [rad]",
    laws=free_memory("of angle over command", "moved", "rad", "settle", moves=True),
)  # fmt: skip
joint_angle = Point(
    "shown", JOINTS, "angle", "angle at the joint [rad], from that of its drive",
    laws=(
        *free_memory("of angle over command of the next joint", "ahead", "rad", "settle", moves=True),
        *free_memory("of angle over command of the previous joint", "behind", "rad", "settle", moves=True),
    ),
)  # fmt: skip
settle = Point(
    "settle", JOINTS, "dt, moved, ahead, behind, setting",
    "states of the effects on joint j; moved: how far its aim moved in this tick [rad], first from where the joint "
    "stands; ahead, behind: those of the next and the previous joint, 0 at the ends; setting: of this joint [rad]",
    laws=(),
)  # fmt: skip


def other(values, first, k, count):
    """The k-th of `count` values from `first` on, 0 beyond the ends."""
    return values[first + k] if 0 <= k < count else 0.0


def update(x, z, n, e, dt, command, origin, setting, ready):
    """One tick; signals [rad]. x: angles, aims, their moves, started; ready: frames that have begun.

    In the first frame the joints stand where the log starts.
    """
    count = command.shape[0]
    if ready[0] > 1.0:
        first = x[3 * count] == 0.0
        for j in range(count):
            after, before = other(command, 0, j + 1, count), other(command, 0, j - 1, count)
            aim = aim_joint(e, z, j, n.ratio[j] * command[j], after, before, setting[j])
            x[2 * count + j] = 0.0 if first else aim - x[count + j]
            x[count + j] = aim
        for j in range(count):
            ahead, behind = other(x, 2 * count, j + 1, count), other(x, 2 * count, j - 1, count)
            moved = x[count + j] - x[j] if first else x[2 * count + j]
            settle(e, z, j, dt, moved, ahead, behind, setting[j])
            x[j] = follow_aim(e, z, j, x[count + j], x[j], dt, setting[j])
        x[3 * count] = 1.0
    else:
        for j in range(count):
            x[j] = origin[j]


def output(x, z, n, e, angle):
    """Angles [rad]."""
    for j in range(angle.shape[0]):
        angle[j] = joint_angle(e, z, j, x[j])


PART = Part(
    name="joint", module=sys.modules[__name__], parameters=Parameters,
    states=(
        State("angle", JOINTS, unit="rad"), State("aim", JOINTS, unit="rad"), State("moved", JOINTS, unit="rad"),
        State("started", SCALAR),
    ),
    tasks=(Task("update", ("command", "origin", "setting", "ready")),), outputs=(Output("output", ("angle",)),),
    points=(aim_joint, follow_aim, joint_angle, settle),
)  # fmt: skip
