"""Encoder on the gear's output, read over the bus: stroke = r theta, theta rounded to q_theta."""

import sys

from exodrake.model.part import SCALAR, TENDONS, FreeLaw, Output, Part, Point, State, Task, parameter_class
from exodrake.physics.arithmetic import round_to

# resolution at the gear's output, and the spool radius that turns it into wire
Parameters = parameter_class((SCALAR, {"q_theta": "rad", "radius": "m"}))

home_stroke = Point("homed", TENDONS, "stroke", "stroke [m] as counted from the encoder's zero, before rounding",
                    laws=(FreeLaw("error of the reading over stroke", "stroke", "m"),))  # fmt: skip


def read(x, z, n, e, j, spool_angle):
    """The bus reads encoder j; signal [rad]."""
    x[j] = round_to(home_stroke(e, z, j, n.radius * spool_angle[j]), n.q_theta * n.radius)


def start(x, z, n, e, start_stroke):
    """Holds the stroke at rest until first read."""
    for j in range(3):
        x[j] = start_stroke[j]


PART = Part(
    name="encoder", module=sys.modules[__name__], parameters=Parameters, states=(State("reading", TENDONS, unit="m"),),
    tasks=(Task("read", ("spool_angle",), slots=(1, 2, 3), per_channel=True),),
    outputs=(Output.of_states(reading="stroke_read"),),
    points=(home_stroke,),
)  # fmt: skip
