"""Wire stiffens as it is stretched (toe region of a braid).

    T_c = soft / stiffening (exp(stiffening x) - 1)          x = s - l          tangent stiffness soft + stiffening T_c

Beyond an exponent of LIMIT the curve goes on straight.
"""

from math import exp, inf

from exodrake.block import WIRES, Effect, Number

LIMIT = 3.0  # exponent from which the curve is straight [-]


def elastic(tension, stretch, wire_stiffness, soft_stiffness, stiffening):
    """Tension of the stretched wire [N]."""
    bent = min(stiffening * stretch, LIMIT)
    steep = exp(bent)
    return soft_stiffness / stiffening * (steep - 1.0 + steep * (stiffening * stretch - bent))


EFFECT = Effect(
    id="tendon.stiffening",
    summary="wire stiffens as it is stretched",
    signature="stroke offset is a curved function of tension, steep at low tension, without a loop",
    source="physics.md 4.B, garment k0 + k1 T [A]",
    at={"tendon.elastic": elastic},
    numbers=(
        Number(
            "soft_stiffness", "N/m", neutral=inf, low=500.0, high=2700.0, over=WIRES, usual=1200.0, scale="reciprocal"
        ),
        Number("stiffening", "1/m", neutral=200.0, low=30.0, high=500.0, over=WIRES, usual=200.0, scale="log"),
    ),
)
