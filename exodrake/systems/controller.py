"""Tension controller: PD admittance from tension error to wire speed, once a frame.

    v_ref = clip(kp (F_ref - F) - kd dF/dt, -v_max, +v_max)

dF/dt is a backward difference over one frame, 0 in the first. This is the paper's Eq. 3 with the sign that damps
(`physics.md` 1.3).
"""

import sys
from typing import Annotated, NamedTuple

from exodrake.core.part import Output, Part, State, Task, Unit
from exodrake.core.signal import SCALAR, TENDONS


class Parameters(NamedTuple):
    """Gains, speed limit and the frame that they were tuned for."""

    kp: Annotated[float, Unit("m/(s N)")]
    kd: Annotated[float, Unit("m/N")]
    v_max: Annotated[float, Unit("m/s")]
    period: Annotated[float, Unit("s")]


COMMAND, BEFORE, STARTED = 0, 3, 6


def damping(rate, kd):
    """Damping part of the command [m/s] from dF/dt [N/s]: slows a rising tension."""
    return -kd * rate


def control(x, z, n, e, tension_ref, tension_read):
    """The law for all wires; signals [N]."""
    for j in range(3):
        rate = (tension_read[j] - x[BEFORE + j]) / n.period if x[STARTED] > 0.0 else 0.0
        wanted = n.kp * (tension_ref[j] - tension_read[j]) + damping(rate, n.kd)
        x[COMMAND + j] = min(max(wanted, -n.v_max), n.v_max)
        x[BEFORE + j] = tension_read[j]
    x[STARTED] = 1.0


def output(x, z, n, e, speed_cmd):
    """Speed commands [m/s]."""
    for j in range(3):
        speed_cmd[j] = x[COMMAND + j]


def start(x, z, n, e, start_stroke):
    """At rest, nothing read."""
    x[:] = 0.0


PART = Part(
    name="controller",
    module=sys.modules[__name__],
    parameters=Parameters,
    states=(State("command", TENDONS, unit="m/s"), State("before", TENDONS, unit="N"), State("started", SCALAR)),
    tasks=(Task("control", ("tension_ref", "tension_read"), slots=(4,)),),
    outputs=(Output("output", ("speed_cmd",)),),
)
