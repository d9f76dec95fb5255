"""Motors behind gears with current loops: the reference effort becomes a current within its limit, then an effort.

    i_ref = min(max(tau_ref / (k_t N), -i_max), i_max)       time_constant i' = i_ref - i       tau = k_t N i

The reported effort is the one that the current stands for with these constants; what the joint gets passes the point.
"""

import sys
from math import exp

from exodrake.model.part import JOINTS, Output, Part, Point, State, Task, parameter_class

# torque constant, gear ratio (of a sliding joint in 1/m), limit of the current, time constant of its loop or 0
Parameters = parameter_class(
    (JOINTS, {"torque_constant": "N m/A", "ratio": "-", "current_max": "A", "time_constant": "s"})
)

joint_effort = Point("driven", JOINTS, "effort", "effort on joint j [N m], from the one that the current stands for")


def update(x, z, n, e, dt, effort_ref):
    """Currents after a tick, exact for a reference held over it; signal [N m]. x: currents [A], efforts [N m]."""
    count = effort_ref.shape[0]
    for j in range(count):
        scale = n.torque_constant[j] * n.ratio[j]
        aim = min(max(effort_ref[j] / scale, -n.current_max[j]), n.current_max[j])
        x[j] = aim + (x[j] - aim) * exp(-dt / n.time_constant[j]) if n.time_constant[j] > 0.0 else aim
        x[count + j] = scale * x[j]
        x[2 * count + j] = joint_effort(e, z, j, scale * x[j])


PART = Part(
    name="motor", module=sys.modules[__name__], parameters=Parameters,
    states=(
        State("current", JOINTS, unit="A"), State("effort", JOINTS, unit="N m"),
        State("effort_true", JOINTS, unit="N m"),
    ),
    tasks=(Task("update", ("effort_ref",)),), outputs=(Output.of_states(effort="effort", effort_true="effort_true"),),
    points=(joint_effort,),
)  # fmt: skip
