"""Motion capture: joint angles with white noise, once a frame.

Where its clock and the controller's meet, a picture may be late: the log takes it of the angle at t - lateness.
"""

import sys

from exodrake.model.part import JOINTS, SCALAR, FreeLaw, Output, Part, Point, State, Task, parameter_class

Parameters = parameter_class((SCALAR, {"sigma_q": "rad", "period": "s"}))  # noise of an angle, time between pictures
READING, LATE, PICTURES = 0, 3, 4

marker_angle = Point("seen", JOINTS, "angle", "angle of joint i [rad] as the markers show it",
                     laws=(FreeLaw("error of the reading over angle", "angle", "rad"),))  # fmt: skip
late = Point("late", SCALAR, "delay, clock",
             "how late the picture is [s]; clock: the controller's time at this picture [s]",
             laws=(FreeLaw("delay over time", "clock", "s"),))  # fmt: skip


def sample(x, z, n, e, angle, noise_angle):
    """One sample of all joints: signals [rad], standard normal noise."""
    for i in range(3):
        x[READING + i] = marker_angle(e, z, i, angle[i]) + n.sigma_q * noise_angle[i]
    x[LATE] = late(e, z, 0.0, x[PICTURES] * n.period)
    x[PICTURES] += 1.0


PART = Part(
    name="mocap", module=sys.modules[__name__], parameters=Parameters,
    states=(State("reading", JOINTS, unit="rad"), State("lateness", SCALAR, unit="s"), State("pictures", SCALAR)),
    tasks=(Task("sample", ("angle", "noise_angle"), slots=(0,)),),
    outputs=(Output.of_states(reading="angle_read", lateness="mocap_delay"),),
    points=(marker_angle, late),
)  # fmt: skip
