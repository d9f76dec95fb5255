"""Dry friction with a higher level near standstill.

level(v) = force (1 + (ratio - 1) exp(-(v / v_s)^2))          v after the tick = v - sgn(v) min(|v|, level dt / M)
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.effects.friction.stribeck import level
from exodrake.physics.dry_friction import slowed


def braked(speed, mobility, load, force, ratio, stribeck_speed):
    """Speed [m/s] after dry friction acted for a tick; mobility: dt / M [s/kg]."""
    return slowed(speed, level(speed, force, ratio, stribeck_speed) * mobility)


EFFECT = Effect(
    id="sliding.stribeck_friction",
    summary="dry friction with a higher level near standstill",
    signature="as dry friction, with more force at slow motion",
    source="Armstrong-Helouvry et al., Automatica 30(7), 1994; range assumed",
    at={"sliding.braked": braked},
    parameters=(
        EffectParameter("force", "force", null=0.0, low=0.13, high=4.0, default=1.0),
        EffectParameter("ratio", "-", null=1.0, low=1.1, high=3.0, default=1.5),
        EffectParameter("speed", "speed", null=0.1, low=0.02, high=1.0, default=0.1, transform="log"),
    ),
    family="friction",
    order=125,
)
