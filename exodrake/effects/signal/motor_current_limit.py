"""Current is limited lower than nominal, with a knee.

i = u / (1 + |u / limit|^(1 / knee))^knee        u = Kp e + z        knee -> 0: i = clip(u, -limit, +limit)
"""

from math import copysign, inf

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def current_limit(nominal, limit, knee):
    """Current at which the drive clips [A]."""
    return min(nominal, limit)


def current(clipped, wanted, nominal, limit, knee):
    """Current that flows [A]."""
    used = abs(wanted) / limit
    if knee <= HARD or used < NONE:
        return clipped
    return copysign(min(nominal, limit / (1.0 + used ** (-1.0 / knee)) ** knee), wanted)


HARD = 0.01  # knee below which the current is clipped
NONE = 1e-3  # share of the limit below which the knee does not show [-]

EFFECT = Effect(
    id="motor.current_limit",
    summary="current is limited lower than nominal",
    signature="tension levels off and speed falls short where load or acceleration is high",
    source="physics.md 4.A; 0.11 A holds 12 N at the wire, above 0.12 A nothing clips; knee assumed",
    at={"motor.current_limit": current_limit, "motor.current": current},
    parameters=(
        EffectParameter(
            "limit", "A", null=inf, low=0.02, high=0.12, axis=TENDONS, default=0.06, transform="reciprocal"
        ),
        EffectParameter("knee", "-", null=0.2, low=0.02, high=0.5, axis=TENDONS, default=0.2, transform="log"),
    ),
    family="saturation",
    order=120,
)
