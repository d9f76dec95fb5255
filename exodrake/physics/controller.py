"""Tension controller: admittance from tension error to wire speed, once a frame.

    v_ref = clip(kp (R - F) + ki E - kd D + u, -v_max, +v_max)

    E' = R - F      tau_D D' + D = dF/dt      tau_R R' + R = F_ref      u = feed C dR/dt

dF/dt is a backward difference over one frame, 0 in the first. With ki, tau_D, tau_R and feed at 0 this is the paper's
Eq. 3 with the sign that damps (`physics.md` 1.3). E rests while the command is clipped and the error pushes on. C is
the static compliance of finger and tendons, the inverse of their tension Jacobian: `compliance_k` holds the wire that
each tendon takes in for a newton more on tendon k. Lags are backward differences.
"""

import sys

from exodrake.model.part import SCALAR, TENDONS, Output, Part, State, Task, parameter_class

# gains, speed limit and the frame that they were tuned for, lags, compliance
Parameters = parameter_class(
    (SCALAR, {"kp": "m/(s N)", "kd": "m/N", "v_max": "m/s", "period": "s", "ki": "m/(s2 N)"}),
    (SCALAR, {"tau_D": "s", "tau_R": "s", "feed": "-"}),
    (TENDONS, {"compliance_1": "m/N", "compliance_2": "m/N", "compliance_3": "m/N"}),
)
COMMAND, BEFORE, STARTED, INTEGRAL, RATE, MODEL = 0, 3, 6, 7, 10, 13


def damping(rate, kd):
    """Damping part of the command [m/s] from dF/dt [N/s]: slows a rising tension."""
    return -kd * rate


def damping_as_printed(rate, kd):
    """The same with the sign printed in the paper's Eq. 3, a variant: it undamps (`physics.md` 1.3)."""
    return kd * rate


def lag(before, value, period, tau):
    """First-order lag of a value after a frame."""
    share = period / (period + tau)
    return share * value + (1.0 - share) * before


def control(x, z, n, e, tension_ref, tension_read):
    """The law for all wires; signals [N]."""
    if x[STARTED] == 0.0:
        for j in range(3):
            x[MODEL + j] = tension_ref[j]
    models = (
        lag(x[MODEL], tension_ref[0], n.period, n.tau_R),
        lag(x[MODEL + 1], tension_ref[1], n.period, n.tau_R),
        lag(x[MODEL + 2], tension_ref[2], n.period, n.tau_R),
    )
    climb = (
        n.feed * (models[0] - x[MODEL]) / n.period,
        n.feed * (models[1] - x[MODEL + 1]) / n.period,
        n.feed * (models[2] - x[MODEL + 2]) / n.period,
    )
    for j in range(3):
        rate = (tension_read[j] - x[BEFORE + j]) / n.period if x[STARTED] > 0.0 else 0.0
        x[RATE + j] = lag(x[RATE + j], rate, n.period, n.tau_D)
        error = models[j] - tension_read[j]
        area = x[INTEGRAL + j] + n.period * error
        feed = n.compliance_1[j] * climb[0] + n.compliance_2[j] * climb[1] + n.compliance_3[j] * climb[2]
        wanted = n.kp * error + damping(x[RATE + j], n.kd) + n.ki * area + feed
        if abs(wanted) <= n.v_max or wanted * error <= 0.0:
            x[INTEGRAL + j] = area
        x[COMMAND + j] = min(max(wanted, -n.v_max), n.v_max)
        x[BEFORE + j] = tension_read[j]
        x[MODEL + j] = models[j]
    x[STARTED] = 1.0


PART = Part(
    name="controller", module=sys.modules[__name__], parameters=Parameters,
    states=(
        State("command", TENDONS, unit="m/s"), State("before", TENDONS, unit="N"), State("started", SCALAR),
        State("integral", TENDONS, unit="N s"), State("rate", TENDONS, unit="N/s"), State("model", TENDONS, unit="N"),
    ),
    tasks=(Task("control", ("tension_ref", "tension_read"), slots=(4,)),),
    outputs=(Output.of_states(command="speed_cmd"),),
)  # fmt: skip
