"""Load-independent friction on the wire between cell and finger.

T_d = T_c - force slide        slide -> +1 while the finger takes wire in, -1 while it gives wire back
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def transmit(tension, slide, travel, speed, force):
    """Tension at the finger [N]."""
    return tension - force * slide


EFFECT = Effect(
    id="tendon.coulomb_friction",
    summary="load-independent friction on the wire",
    signature="loop of angle against tension of constant width, rate-free; none of angle against stroke",
    source="physics.md 4.B; 0.1-1 N",
    at={"tendon.transmit": transmit},
    parameters=(EffectParameter("force", "N", null=0.0, low=0.05, high=1.5, axis=TENDONS, default=0.4),),
    family="friction",
    order=235,
)
