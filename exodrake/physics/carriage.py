"""Carriage on a linear guide, pushed by a drive: a mass, and nothing else nominally.

    M v' = F          x' = v

The friction family (`sliding.*`) acts here; `scales`: of a drive of 200 N that moves some 0.1 m in a second.

Euler's rule for the speed and the trapezium's for the place, exact for a force held over a tick. Dry friction takes
speed away after the push, at most all of it, so that a fixed step never turns a stop into a push.
"""

import sys

from exodrake.model.part import SCALAR, Output, Part, Point, State, Task, parameter_class

Parameters = parameter_class((SCALAR, {"M": "kg"}))  # moving mass, the motor's inertia included
PLACE, SPEED, STARTED = 0, 1, 2

push_carriage = Point("pushed", SCALAR, "force, speed", "force on the mass [N], from that of the drive; speed [m/s]",
                      standard="sliding.pushed")  # fmt: skip
brake_carriage = Point("braked", SCALAR, "speed, mobility, load",
                       "speed [m/s] after dry friction; mobility: dt / M [s/kg]; load: size of the drive's force [N]",
                       standard="sliding.braked")  # fmt: skip
settle = Point("settle", SCALAR, "dt, travel", "states of the effects after dt [s]; travel [m]",
               standard="sliding.settle")  # fmt: skip


def update(x, z, n, e, dt, force):
    """One tick; signal [N]."""
    if x[STARTED] > 0.0:
        before = x[SPEED]
        free = before + dt * push_carriage(e, z, force[0], before) / n.M
        x[SPEED] = brake_carriage(e, z, free, dt / n.M, abs(force[0]))
        travel = 0.5 * dt * (before + x[SPEED])
        x[PLACE] += travel
        settle(e, z, dt, travel)


def place(x, z, n, e, position_start, speed_start):
    """Place and speed at the start of the log, taken in the first frame; signals [m], [m/s]."""
    if x[STARTED] == 0.0:
        x[PLACE] = position_start[0]
        x[SPEED] = speed_start[0]
        x[STARTED] = 1.0


PART = Part(
    name="carriage", module=sys.modules[__name__], parameters=Parameters,
    states=(State("place", SCALAR, unit="m"), State("speed", SCALAR, unit="m/s"), State("started", SCALAR)),
    tasks=(Task("update", ("force",)), Task("place", ("position_start", "speed_start"), slots=(0,))),
    outputs=(Output.of_states(place="position"),),
    points=(push_carriage, brake_carriage, settle),
    scales={"force": (15.0, "N"), "speed": (0.1, "m/s"), "force/speed": (150.0, "N s/m"), "length": (0.1, "m")},
)  # fmt: skip
