"""Drive with a position loop around a speed loop, once a frame; the amplifier is a gain.

    u = kv (kp (x_ref - x) - dx/dt)          F = gain u

dx/dt is the difference over two frames, at first the speed at the start. Gains: Janot, Gautier, Brunot 2019 (EMPS). Two
frames: found here, as with the published gains the law then gives the recorded output from recorded places to 0.24 %,
with one frame to 3.3 %.
"""

import sys

from exodrake.model.part import SCALAR, Output, Part, State, Task, parameter_class

# gains of the two loops, force per volt, frame; standard deviation of the force between runs
Parameters = parameter_class((SCALAR, {"kp": "1/s", "kv": "V s/m", "gain": "N/V", "period": "s", "repeatability": "N"}))
FORCE, BEFORE, EARLIER, STARTED = 0, 1, 2, 3


def control(x, z, n, e, position_ref, position_read, speed_start):
    """The law; signals [m], [m/s]."""
    if x[STARTED] == 0.0:
        x[BEFORE] = position_read[0] - n.period * speed_start[0]
        x[EARLIER] = x[BEFORE] - n.period * speed_start[0]
    rate = 0.5 * (position_read[0] - x[EARLIER]) / n.period
    x[FORCE] = n.gain * n.kv * (n.kp * (position_ref[0] - position_read[0]) - rate)
    x[EARLIER], x[BEFORE] = x[BEFORE], position_read[0]
    x[STARTED] = 1.0


PART = Part(
    name="drive", module=sys.modules[__name__], parameters=Parameters,
    states=(State("force", SCALAR, unit="N"), State("before", SCALAR, 2, "m"), State("started", SCALAR)),
    tasks=(Task("control", ("position_ref", "position_read", "speed_start"), slots=(2,)),),
    outputs=(Output.of_states(force="force"),),
)  # fmt: skip
