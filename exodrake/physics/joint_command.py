"""Commands of a machine's joints, taken once a frame and handed to their drives; it also hands on where the log starts.

Blocks: `PART`, `SET_PART` for joints that have a setting of their own, such as the bend of a sheath, and `TICK_PART`,
for drives with dynamics: a command that is late by a part of a frame reaches them within it.
"""

import sys
from dataclasses import replace

from exodrake.model.part import JOINTS, SCALAR, Output, Part, Point, State, Task, parameter_class
from exodrake.physics.arithmetic import remember

DEPTH = 12  # commands remembered per joint, the newest first: as many as the motor bus remembers
# places of the last states: frames so far, ticks of the frame so far and of one frame, from the first command on
FRAMES, TICKS, LENGTH = -3, -2, -1
HELD_OFF = 0.05  # rad that weight, friction and an offset keep a servo off its command: assumed, the usual 3 degrees

send = Point("sent", JOINTS, "command, history, first, passed, step, applied, packet_arrival, frame_arrival",
             "angle [rad] that reaches drive j, from the newest command; history: commands of all joints [rad], the "
             "newest of this one at `first`, older ones after it; passed, step: shares of the frame that have passed "
             "and that the angle holds for; applied: angle so far [rad]; packet_arrival, frame_arrival: 1, as no "
             "command is ever lost or late here", laws=())  # fmt: skip


def take(x, z, n, e, angle_ref, angle_start):
    """One command for every joint; signals [rad]."""
    joints, frames = angle_ref.shape[0], x[FRAMES]
    x[LENGTH], x[TICKS], x[FRAMES] = max(x[TICKS], 1.0), 0.0, frames + 1.0
    for j in range(joints):
        newest, last = DEPTH * j, DEPTH * j + 1
        for _ in range(1 if frames > 0.0 else DEPTH):
            remember(x, newest, DEPTH, angle_ref[j])
        for k in range(1, DEPTH - 1 if frames == 1.0 else 0):  # in the second frame: the last command was the first one
            x[last + k] = command_before(x[last], x[newest] - x[last], angle_start[j], k)
        x[(DEPTH + 1) * joints + j] = angle_start[j]
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
    for j in range(joints):
        held, step = DEPTH * joints + j, 1.0 / x[LENGTH]
        x[held] = send(e, z, j, x[DEPTH * j], x, DEPTH * j, x[TICKS] * step, step, x[held], 1.0, 1.0)


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
        x[(DEPTH + 2) * joints + j] = bend[j]


PART = Part(
    name="command", module=sys.modules[__name__], parameters=parameter_class(),
    states=(
        State("history", JOINTS, DEPTH, "rad"), State("held", JOINTS, unit="rad"), State("origin", JOINTS, unit="rad"),
        State("setting", JOINTS, unit="rad"), State("frames", SCALAR), State("ticks", SCALAR), State("length", SCALAR),
    ),
    tasks=(Task("take", ("angle_ref", "angle_start"), slots=(0,)),),
    outputs=(Output.of_states(held="command", origin="origin", setting="setting", frames="ready"),),
    points=(send,), group="timing",
)  # fmt: skip
SET_PART = replace(PART, tasks=(Task("take_set", ("angle_ref", "angle_start", "bend"), slots=(0,)),))
TICK_PART = replace(PART, tasks=(*PART.tasks, Task("hold", ("angle_ref",))))
