"""Play between a moving part and its sensor: the reading rests until the slack is taken up.

shown <- min(max(shown, value - half_width), value + half_width)
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State


def shown(value, clock, period, half_width, held):
    """Value as shown, then the same as what the sensor rests at."""
    after = min(max(held, value - half_width), value + half_width) if clock > 0.0 else value
    return after, after


EFFECT = Effect(
    id="signal.backlash",
    summary="play before the sensor",
    signature="loop of constant width, rate-free, with flat pieces after each reversal",
    source="couplings and gears before a sensor; range assumed",
    at={"signal.shown": shown},
    parameters=(EffectParameter("half_width", "value", null=0.0, low=0.005, high=0.3, default=0.05),),
    states=(State("held", unit="value"),),
    filters=("signal.shown",),
    family="backlash",
    order=732,
)
