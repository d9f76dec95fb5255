"""Dry friction with a higher level near standstill.

level(v) = force (1 + (ratio - 1) exp(-(v / v_s)^2))          v after the tick = v - sgn(v) min(|v|, level dt / M)
"""

from math import exp

from exodrake.core.effect import Effect, Number


def level(speed, force, ratio, stribeck_speed):
    """Friction while sliding at this speed [N]."""
    return force * (1.0 + (ratio - 1.0) * exp(-(speed / stribeck_speed) * (speed / stribeck_speed)))


def braked(speed, mobility, force, ratio, stribeck_speed):
    """Speed [m/s] after dry friction acted for a tick; mobility: dt / M [s/kg]."""
    loss = level(speed, force, ratio, stribeck_speed) * mobility
    return speed - loss if speed > loss else speed + loss if speed < -loss else 0.0


EFFECT = Effect(
    id="carriage.stribeck_friction",
    summary="dry friction with a higher level near standstill",
    signature="as dry friction, with more force at slow motion",
    source="Armstrong-Helouvry et al., Automatica 30(7), 1994; range assumed",
    at={"carriage.braked": braked},
    numbers=(
        Number("force", "N", neutral=0.0, low=2.0, high=60.0, usual=15.0),
        Number("ratio", "-", neutral=1.0, low=1.1, high=3.0, usual=1.5),
        Number("speed", "m/s", neutral=0.01, low=0.002, high=0.1, usual=0.01, scale="log"),
    ),
)
