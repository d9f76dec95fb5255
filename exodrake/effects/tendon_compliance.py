"""Garment or anchor yields at the finger, in series with the wire.

T_c = k_s (s - l)          1 / k_s = 1 / k + 1 / stiffness
"""

from math import inf

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def elastic(tension, stretch, wire_stiffness, stiffness):
    """Tension [N] of wire and garment in series."""
    return tension * stiffness / (wire_stiffness + stiffness)


EFFECT = Effect(
    id="tendon.compliance",
    summary="garment or anchor yields at the finger, in series with the wire",
    signature="stroke offset proportional to tension, without a loop and at every rate; angle against tension as ever",
    source="physics.md 4.B; 0.5-10 N/mm [A]",
    at={"tendon.elastic": elastic},
    parameters=(
        EffectParameter(
            "stiffness", "N/m", null=inf, low=5e2, high=2e4, axis=TENDONS, default=3e3, transform="reciprocal"
        ),
    ),
    family="elasticity",
    order=225,
)
