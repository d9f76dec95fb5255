"""Motor bus: hands each speed command to its drive in its slot, held until the next one (`physics.md`, Timing)."""

import sys

from exodrake.model.part import TENDONS, Output, Part, Point, State, Task, parameter_class
from exodrake.physics.arithmetic import remember

DEPTH = 12  # commands remembered per wire, the newest first

send = Point("sent", TENDONS, "command, history, first, depth, passed, step, held, arrival, frame_arrival",
             "speed [m/s] that reaches drive j, from the newest command; history: commands of all tendons [m/s], the "
             "newest of this one at `first`, `depth` of them; passed, step: 0 and 1, shares of the frame that have "
             "passed and that the speed holds for; held: speed so far [m/s]; arrival, frame_arrival: uniform draws in "
             "0 .. 1 of this frame, for this drive and for all drives", laws=())  # fmt: skip


def write(x, z, n, e, j, speed_cmd, packet_arrival):
    """The bus writes to drive j; signal [m/s], uniform draws."""
    remember(x, DEPTH * j, DEPTH, speed_cmd[j])
    applied = 3 * DEPTH + j
    arrival, of_all = packet_arrival[j], packet_arrival[0]
    x[applied] = send(e, z, j, speed_cmd[j], x, DEPTH * j, DEPTH, 0.0, 1.0, x[applied], arrival, of_all)


PART = Part(
    name="bus", module=sys.modules[__name__], parameters=parameter_class(),
    states=(State("history", TENDONS, DEPTH, "m/s"), State("applied", TENDONS, unit="m/s")),
    tasks=(Task("write", ("speed_cmd", "packet_arrival"), slots=(5, 6, 7), per_channel=True),),
    outputs=(Output.of_states(applied="speed_applied"),), points=(send,), group="timing",
)  # fmt: skip
