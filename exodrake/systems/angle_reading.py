"""Joint angles as read by a camera, a tracker or encoders: with white noise and rounding, at the end of a frame."""

import sys
from typing import Annotated, NamedTuple

from exodrake.core.part import Output, Part, Point, State, Task, Unit
from exodrake.core.signal import JOINTS
from exodrake.systems.rounding import rounded


class Parameters(NamedTuple):
    """Noise and resolution of each joint's reading; floor: standard deviation between equal runs (in no equation)."""

    sigma: Annotated[tuple, Unit("rad", JOINTS)]
    step: Annotated[tuple, Unit("rad", JOINTS)]
    floor: Annotated[float, Unit("rad")]


def seen(e, z, i, angle):
    """Point: angle of joint i [rad] as the sensor shows it."""
    return angle


def read(x, z, n, e, angle, noise_angle):
    """One reading of all joints; signals [rad], standard normal."""
    for i in range(angle.shape[0]):
        x[i] = rounded(seen(e, z, i, angle[i]) + n.sigma[i] * noise_angle[i], n.step[i])


def output(x, z, n, e, angle_read):
    """Last readings [rad]."""
    for i in range(angle_read.shape[0]):
        angle_read[i] = x[i]


def start(x, z, n, e, start_stroke):
    """Nothing read yet."""
    x[:] = 0.0


PART = Part(
    name="reading",
    module=sys.modules[__name__],
    parameters=Parameters,
    states=(State("reading", JOINTS, unit="rad"),),
    tasks=(Task("read", ("angle", "noise_angle"), slots=(3,)),),
    outputs=(Output("output", ("angle_read",)),),
    points=(Point("seen", JOINTS),),
)
