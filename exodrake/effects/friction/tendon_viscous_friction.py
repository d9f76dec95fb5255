"""Friction proportional to wire speed, between cell and finger.

T_d = T_c - coefficient v          v > 0 while the finger takes wire in
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS
from exodrake.effects.friction.grip import gripped


def transmit(tension, slide, travel, speed, coefficient):
    """Tension at the finger [N]."""
    return tension - gripped(coefficient * speed, tension)


EFFECT = Effect(
    id="tendon.viscous_friction",
    summary="friction proportional to wire speed",
    signature="loop of angle against tension whose width grows with speed and vanishes at rest",
    source="physics.md 4.B; 0.5-5 N s/m",
    at={"tendon.transmit": transmit},
    parameters=(EffectParameter("coefficient", "N s/m", null=0.0, low=0.5, high=20.0, axis=TENDONS, default=5.0),),
    family="friction",
    order=255,
)
