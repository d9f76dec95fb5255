"""Linear scale: the carriage's place with white noise and rounding, once a frame."""

import sys
from typing import Annotated, NamedTuple

from exodrake.core.part import Output, Part, State, Task, Unit
from exodrake.core.signal import SCALAR
from exodrake.systems.rounding import rounded


class Parameters(NamedTuple):
    """Noise and resolution, and by how much runs of one motion differ (no equation uses it)."""

    sigma: Annotated[float, Unit("m")]
    step: Annotated[float, Unit("m")]
    floor: Annotated[float, Unit("m")]


def read(x, z, n, e, position, noise_position):
    """One reading; signals [m], standard normal."""
    x[0] = rounded(position[0] + n.sigma * noise_position[0], n.step)


def output(x, z, n, e, position_read):
    """The last reading [m]."""
    position_read[0] = x[0]


def start(x, z, n, e, start_stroke):
    """Nothing read yet."""
    x[:] = 0.0


PART = Part(
    name="scale",
    module=sys.modules[__name__],
    parameters=Parameters,
    states=(State("reading", SCALAR, unit="m"),),
    tasks=(Task("read", ("position", "noise_position"), slots=(1,)),),
    outputs=(Output("output", ("position_read",)),),
)
