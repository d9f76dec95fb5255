"""Outer loop about position servos, once a frame: what a computer adds to the reference of drives that it cannot open.

    sent = q_d + kp e + ki E      E' = e      e = q_d of the frame before - q      lag q_d' = q_ref - q_d

The error is that of the reference which the reading answers, so ideal servos get the reference itself.
"""

import sys

from exodrake.model.part import JOINTS, SCALAR, Output, Part, State, Task, parameter_class

# gains, lag of a filter of the reference, and the frame that they were tuned for
Parameters = parameter_class((SCALAR, {"kp": "-", "ki": "1/s", "lag": "s", "period": "s"}))


def control(x, z, n, e, angle_ref, angle_read):
    """The law; signals [rad]. x: angles sent, integrals of the errors [rad s], filtered references before, started."""
    count, kept = angle_ref.shape[0], n.lag / (n.lag + n.period) if x[3 * angle_ref.shape[0]] > 0.0 else 0.0
    for j in range(count):
        desired = angle_ref[j] + kept * (x[2 * count + j] - angle_ref[j])
        error = x[2 * count + j] - angle_read[j] if x[3 * count] > 0.0 else 0.0  # nothing is read in the first frame
        x[count + j] += n.period * error
        x[j] = desired + n.kp * error + n.ki * x[count + j]
        x[2 * count + j] = desired
    x[3 * count] = 1.0


PART = Part(
    name="joint_loop", module=sys.modules[__name__], parameters=Parameters,
    states=(
        State("sent", JOINTS, unit="rad"), State("integral", JOINTS, unit="rad s"), State("before", JOINTS, unit="rad"),
        State("started", SCALAR),
    ),
    tasks=(Task("control", ("angle_ref", "angle_read"), slots=(0,)),), outputs=(Output.of_states(sent="angle_sent"),),
)  # fmt: skip
