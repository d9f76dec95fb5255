"""A reading that starts only from a width on.

shown = value - min(max(value, -width), width)
"""

from exodrake.core.effect import Effect, EffectParameter


def shown(value, clock, period, width):
    """Value as shown."""
    return value - min(max(value, -width), width)


EFFECT = Effect(
    id="signal.dead_zone",
    summary="reading starts only from a width on",
    signature="reading 0 near 0, and short by the width beyond",
    source="threshold in a driver, a loose coupling centred by a spring; range assumed",
    at={"signal.shown": shown},
    parameters=(EffectParameter("width", "value", null=0.0, low=0.005, high=0.3, default=0.05),),
    family="dead zone",
    order=748,
)
