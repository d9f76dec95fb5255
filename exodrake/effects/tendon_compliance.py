"""Garment or anchor yields at the finger, in series with the wire, and stiffens under load.

T_c / k + T_c / (stiffness + stiffening T_c) = s - l        it yields by 1 / stiffening at most
"""

from math import inf, sqrt

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def elastic(tension, stretch, wire_stiffness, stiffness, stiffening):
    """Tension [N] of wire and garment in series; the root of a quadratic, without the difference of its two terms."""
    if stretch <= 0.0 or stiffness > RIGID * wire_stiffness:
        return tension
    half = 0.5 * (1.0 + stiffness / wire_stiffness - stiffening * stretch)
    root = sqrt(half * half + stiffening / wire_stiffness * stiffness * stretch)
    return stiffness * stretch / (half + root) if half > 0.0 else (root - half) * wire_stiffness / stiffening


RIGID = 1e6  # times the wire's stiffness

EFFECT = Effect(
    id="tendon.compliance",
    summary="garment or anchor yields at the finger, in series with the wire",
    signature="stroke offset that grows with tension, without a loop and at every rate; angle against tension as ever",
    source="physics.md 4.B; 0.5-10 N/mm, k0 + k1 T [A]",
    at={"tendon.elastic": elastic},
    parameters=(
        EffectParameter(
            "stiffness", "N/m", null=inf, low=5e2, high=2e4, axis=TENDONS, default=3e3, transform="reciprocal"
        ),
        EffectParameter(
            "stiffening", "1/m", null=50.0, low=10.0, high=1000.0, axis=TENDONS, default=50.0, transform="log"
        ),
    ),
    family="elasticity",
    order=225,
)
