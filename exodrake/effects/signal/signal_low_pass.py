"""A first-order filter in a reading, exact for a value held over a sample.

time_constant shown' = value - shown
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.effects.relaxation import relaxed


def shown(value, clock, period, time_constant, filtered):
    """Value as shown, then the filter's state."""
    after = relaxed(filtered, value, period, time_constant) if clock > 0.0 else value
    return after, after


EFFECT = Effect(
    id="signal.low_pass",
    summary="first-order filter in the reading",
    signature="reading lags, and is smaller in fast motion; nothing at rest",
    source="amplifiers and smoothing in drivers; range assumed",
    at={"signal.shown": shown},
    parameters=(EffectParameter("time_constant", "period", null=0.0, low=0.3, high=30.0, default=3.0),),
    states=(State("filtered", unit="value"),),
    filters=("signal.shown",),
    family="lag",
    order=758,
)
