"""A reading that clips at both ends.

shown = min(max(value, -limit), limit)
"""

from math import inf

from exodrake.core.effect import Effect, EffectParameter


def shown(value, clock, period, limit):
    """Value as shown."""
    return min(max(value, -limit), limit)


EFFECT = Effect(
    id="signal.saturation",
    summary="reading clips at both ends",
    signature="reading levels off at one value, alike in both directions",
    source="range of a sensor or converter; range assumed",
    at={"signal.shown": shown},
    parameters=(EffectParameter("limit", "value", null=inf, low=0.05, high=0.35, default=0.2, transform="reciprocal"),),
    family="saturation",
    order=750,
)
