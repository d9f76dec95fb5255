"""Commands of a machine's joints, taken once a frame and handed to their drives; it also hands on where the log starts.

`commands` makes the block. A command that is late by a part of a frame reaches drives with dynamics within it.
"""

import sys
from math import ceil

from exodrake.model.part import JOINTS, SCALAR, Output, Part, Point, State, Task, parameter_class
from exodrake.physics.arithmetic import remember

# commands remembered per joint, the newest first: as many as the motor bus remembers, and those of so many seconds, in
# which a servo answers at the latest; assumed
LEAST, REMEMBERED = 12, 0.24
# places of the last states: frames so far, ticks of the frame so far and of one frame, from the first command on
FRAMES, TICKS, LENGTH = -3, -2, -1
HELD_OFF = 0.05  # rad that weight, friction and an offset keep a servo off its command: assumed, the usual 3 degrees

send = Point("sent", JOINTS, "command, history, first, depth, passed, step, applied, packet_arrival, frame_arrival",
             "angle [rad] that reaches drive j, from the newest command; history: commands of all joints [rad], the "
             "newest of this one at `first`, `depth` of them; passed, step: shares of the frame that have passed "
             "and that the angle holds for; applied: angle so far [rad]; packet_arrival, frame_arrival: 1, as no "
             "command is ever lost or late here", laws=())  # fmt: skip


def count_remembered(frame):
    """Number of commands that are remembered per joint, one each frame [s]."""
    return max(LEAST, ceil(REMEMBERED / frame))


def depth_of(x, joints):
    """The same by the size of the states: beside those commands three of each joint, and three of all."""
    return (x.shape[0] - 3) // joints - 3


def take(x, z, n, e, angle_ref, angle_start):
    """One command for every joint; signals [rad]."""
    joints, frames = angle_ref.shape[0], x[FRAMES]
    depth = depth_of(x, joints)
    x[LENGTH], x[TICKS], x[FRAMES] = max(x[TICKS], 1.0), 0.0, frames + 1.0
    for j in range(joints):
        newest, last = depth * j, depth * j + 1
        for _ in range(1 if frames > 0.0 else depth):
            remember(x, newest, depth, angle_ref[j])
        for k in range(1, depth - 1 if frames == 1.0 else 0):  # in the second frame: the last command was the first one
            x[last + k] = command_before(x[last], x[newest] - x[last], angle_start[j], k)
        x[(depth + 1) * joints + j] = angle_start[j]
    give(x, z, e, joints)


def command_before(first, step, stands, frames):
    """Command so many frames before the first one of a log, from its first step and where the joint stands [rad].

    A joint behind a command that moves away has followed it so far. Far off one that does not, it has stood there.
    """
    behind = first - stands
    if step * behind > 0.0:
        return first - min(frames * step / behind, 1.0) * behind
    return stands if abs(behind) > HELD_OFF else first


def give(x, z, e, joints):
    """What reaches the drives after that many ticks of the frame, and holds for one of them."""
    depth, step = depth_of(x, joints), 1.0 / x[LENGTH]
    for j in range(joints):
        held, newest = depth * joints + j, depth * j
        x[held] = send(e, z, j, x[newest], x, newest, depth, x[TICKS] * step, step, x[held], 1.0, 1.0)


def hold(x, z, n, e, dt, angle_ref):
    """The same in each tick, whose number in a frame is that of the frame before."""
    if x[LENGTH] > 0.0:
        x[TICKS] += 1.0
        give(x, z, e, angle_ref.shape[0])


def take_set(x, z, n, e, angle_ref, angle_start, bend):
    """The same, with a setting of each joint [rad]."""
    joints = angle_ref.shape[0]
    take(x, z, n, e, angle_ref, angle_start)
    for j in range(joints):
        x[(depth_of(x, joints) + 2) * joints + j] = bend[j]


def commands(frame, settings=(), ticks=False):
    """The block of a machine whose frame takes so long [s].

    settings: names of signals that joints have of their own, such as the bend of a sheath. ticks: for drives with
    dynamics.
    """
    given = "take_set" if settings else "take", ("angle_ref", "angle_start", *settings)
    return Part(
        name="command", module=sys.modules[__name__], parameters=parameter_class(),
        states=(
            State("history", JOINTS, count_remembered(frame), "rad"), State("held", JOINTS, unit="rad"),
            State("origin", JOINTS, unit="rad"), State("setting", JOINTS, unit="rad"),
            State("frames", SCALAR), State("ticks", SCALAR), State("length", SCALAR),
        ),
        tasks=(Task(*given, slots=(0,)), *((Task("hold", ("angle_ref",)),) if ticks else ())),
        outputs=(Output.of_states(held="command", origin="origin", setting="setting", frames="ready"),),
        points=(send,), group="timing",
    )  # fmt: skip
