"""Motor bus: hands each speed command to its drive in the wire's slot, held until the next one (`model.md`, Timing)."""

import sys
from typing import NamedTuple

from exodrake.core.part import Block, Output, Point, State, Task
from exodrake.core.signal import WIRES


class Numbers(NamedTuple):
    """The bus has no numbers of its own."""


DEPTH = 12  # commands remembered per wire, the newest first


def sent(e, z, j, command, history, first, applied, lottery):
    """Point: speed [m/s] that reaches drive j.

    Args: command: the newest [m/s]; history: commands of all wires, the newest of this one at `first`, older ones
        after it; applied: speed held so far [m/s]; lottery: uniform number in 0 .. 1 of this frame.
    """
    return command


def write(x, z, n, e, j, speed_cmd, lottery):
    """The bus writes to drive j; wire [m/s], uniform numbers."""
    for k in range(DEPTH - 1, 0, -1):
        x[DEPTH * j + k] = x[DEPTH * j + k - 1]
    x[DEPTH * j] = speed_cmd[j]
    x[3 * DEPTH + j] = sent(e, z, j, speed_cmd[j], x, DEPTH * j, x[3 * DEPTH + j], lottery[j])


def output(x, z, n, e, speed_applied):
    """Speeds held by the drives [m/s]."""
    for j in range(3):
        speed_applied[j] = x[3 * DEPTH + j]


def start(x, z, n, e, start_stroke):
    """Nothing sent yet."""
    x[:] = 0.0


BLOCK = Block(
    name="bus",
    page=sys.modules[__name__],
    numbers=Numbers,
    states=(State("history", WIRES, DEPTH, "m/s"), State("applied", WIRES, unit="m/s")),
    tasks=(Task("write", ("speed_cmd", "lottery"), slots=(5, 6, 7), lanes=True),),
    outputs=(Output("output", ("speed_applied",)),),
    points=(Point("sent", WIRES),),
    group="timing",
)
