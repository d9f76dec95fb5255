"""Motion capture: joint angles with white noise, once a frame (`model.md`)."""

import sys
from typing import Annotated, NamedTuple

from exodrake.block import JOINTS, Block, Output, Point, State, Task, Unit


class Numbers(NamedTuple):
    """Noise of an angle."""

    sigma_q: Annotated[float, Unit("rad")]


def seen(e, z, i, angle):
    """Point: angle of joint i [rad] as the markers show it."""
    return angle


def sample(x, z, n, e, angle, noise_angle):
    """One picture of all joints: wires [rad], standard normal noise."""
    for i in range(3):
        x[i] = seen(e, z, i, angle[i]) + n.sigma_q * noise_angle[i]


def output(x, z, n, e, angle_read):
    """Last picture [rad]."""
    for i in range(3):
        angle_read[i] = x[i]


def start(x, z, n, e, start_stroke):
    """Nothing seen yet."""
    x[:] = 0.0


BLOCK = Block(
    name="mocap",
    page=sys.modules[__name__],
    numbers=Numbers,
    states=(State("reading", JOINTS, unit="rad"),),
    tasks=(Task("sample", ("angle", "noise_angle"), slots=(0,)),),
    outputs=(Output("output", ("angle_read",)),),
    points=(Point("seen", JOINTS),),
)
