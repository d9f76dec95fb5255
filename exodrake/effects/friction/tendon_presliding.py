"""Dry friction with a soft onset (Dahl's law), between cell and finger; `tendon.lugre` adds peak and damping.

T_d = T_c - F          dF/dx = stiffness (1 - F sgn(x') / force)
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.friction.bristle import bent
from exodrake.effects.friction.grip import kept


def transmit(tension, slide, travel, speed, force, stiffness, bristle):
    """Tension at the finger [N]."""
    return tension - force * kept(bent(bristle, travel, force / stiffness), tension)


def settle(dt, stretched, tension, tension_finger, travel, force, stiffness, bristle):
    """Bristle [-1 .. 1]."""
    return kept(bent(bristle, travel, force / stiffness), tension)


EFFECT = Effect(
    id="tendon.presliding",
    summary="dry friction with a soft onset (Dahl)",
    signature="loop of angle against tension that opens gradually after a reversal; nested minor loops in small motion",
    source="physics.md 4.B; 1e3-1e5 N/m",
    at={"tendon.transmit": transmit, "tendon.settle": settle},
    parameters=(
        EffectParameter("force", "N", null=0.0, low=0.05, high=1.5, axis=TENDONS, default=0.4),
        EffectParameter(
            "stiffness", "N/m", null=500.0, low=50.0, high=1e4, axis=TENDONS, default=500.0, transform="log"
        ),
    ),
    states=(State("bristle", TENDONS),),
    advances=("tendon.settle",),
    family="friction",
    not_tried="another law of tendon.coulomb_friction, which is tried",
    order=245,
)
