"""Current clips lower than nominal.

i = clip(Kp e + z, -limit, +limit)
"""

from math import inf

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def current_limit(nominal, limit):
    """Current at which the drive clips [A]."""
    return min(nominal, limit)


EFFECT = Effect(
    id="motor.current_limit",
    summary="current clips lower than nominal",
    signature="tension levels off and speed falls short where load or acceleration is high",
    source="physics.md 4.A; 0.11 A holds 12 N at the wire, above 0.12 A nothing clips",
    at={"motor.current_limit": current_limit},
    parameters=(
        EffectParameter(
            "limit", "A", null=inf, low=0.02, high=0.12, axis=TENDONS, default=0.06, transform="reciprocal"
        ),
    ),
    family="saturation",
    order=120,
)
