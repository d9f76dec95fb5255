"""Dry friction with a higher level near standstill.

level(v) = force (1 + (ratio - 1) exp(-(v / v_s)^2))          v after the tick = v - sgn(v) min(|v|, level dt / M)
"""

from math import exp

from exodrake.core.effect import Effect, EffectParameter


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
    parameters=(
        EffectParameter("force", "N", null=0.0, low=2.0, high=60.0, default=15.0),
        EffectParameter("ratio", "-", null=1.0, low=1.1, high=3.0, default=1.5),
        EffectParameter("speed", "m/s", null=0.01, low=0.002, high=0.1, default=0.01, transform="log"),
    ),
    family="friction",
    order=125,
)
