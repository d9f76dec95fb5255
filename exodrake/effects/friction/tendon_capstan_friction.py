"""Sheath friction proportional to load, between cell and finger (capstan law).

T_d = T_c exp(-mu_phi slide)        slide -> +1 while the finger takes wire in, -1 while it gives wire back
"""

from math import exp

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def transmit(tension, slide, travel, speed, mu_phi):
    """Tension at the finger [N]."""
    return tension * exp(-mu_phi * slide)


EFFECT = Effect(
    id="tendon.capstan_friction",
    summary="sheath friction proportional to load, between cell and finger",
    signature="loop of angle against tension whose width grows with load, rate-free; none of angle against stroke",
    source="physics.md 4.B; mu phi 0.1-0.9 from exosuit Bowden efficiency 40-60 % [S:Stillsuit], 60 % [S:TUM]",
    at={"tendon.transmit": transmit},
    parameters=(EffectParameter("mu_phi", "-", null=0.0, low=0.05, high=0.9, axis=TENDONS, default=0.3),),
    family="friction",
    order=230,
)
