"""Wire stiffens as it is stretched (toe region of a braid).

    T_c = soft / grows (exp(grows x) - 1)          x = s - l          tangent stiffness soft + grows T_c

The toe is softer than the wire: `grows` is `stiffening` for a soft stiffness of up to 0.8 k and fades to 0 as that
comes to k, from where the wire is k x; else a wire that is hardly affected would be stiffer than steel. Beyond an
exponent of LIMIT the curve goes on straight.
"""

from math import expm1, inf

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS

LIMIT = 3.0  # exponent from which the curve is straight [-]
FADES = 4.0  # it fades once k / soft - 1 is below 1 / FADES [-]: assumed


def elastic(tension, stretch, wire_stiffness, soft_stiffness, stiffening):
    """Tension of the stretched wire [N]."""
    grows = stiffening * min(1.0, FADES * (wire_stiffness / soft_stiffness - 1.0))
    if grows <= 0.0:
        return tension
    bent = min(grows * stretch, LIMIT)
    curved = expm1(bent)
    return soft_stiffness / grows * (curved + (1.0 + curved) * (grows * stretch - bent))


EFFECT = Effect(
    id="tendon.stiffening",
    summary="wire stiffens as it is stretched",
    signature="stroke offset is a curved function of tension, steep at low tension, without a loop",
    source="physics.md 4.B, garment k0 + k1 T [A]; softer than the wire of 2700 N/m",
    at={"tendon.elastic": elastic},
    parameters=(
        EffectParameter(
            "soft_stiffness",
            "N/m",
            null=inf,
            low=500.0,
            high=2500.0,
            axis=TENDONS,
            default=1200.0,
            transform="reciprocal",
        ),
        EffectParameter(
            "stiffening", "1/m", null=200.0, low=30.0, high=500.0, axis=TENDONS, default=200.0, transform="log"
        ),
    ),
    family="elasticity",
    order=215,
)
