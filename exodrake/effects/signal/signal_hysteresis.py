"""A sensor that remembers the way its value has come.

shown = value + error z          dz/dvalue = (1 - z sgn(value')) / width
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.effects.friction.bristle import bent


def shown(value, clock, period, error, width, bristle, before):
    """Value as shown, then the bristle [-1 .. 1] and the value that it has seen."""
    after = bent(bristle, value - before, width) if clock > 0.0 else 0.0
    return value + error * after, after, value


EFFECT = Effect(
    id="signal.hysteresis",
    summary="the sensor remembers the way its value has come",
    signature="reading differs between rising and falling values by an amount independent of rate",
    source="load cells and magnetic sensors, 0.05-1 % of full scale; range assumed",
    at={"signal.shown": shown},
    parameters=(
        EffectParameter("error", "value", null=0.0, low=-0.1, high=0.1, default=0.03),
        EffectParameter("width", "value", null=0.05, low=0.01, high=0.3, default=0.05, transform="log"),
    ),
    states=(State("bristle"), State("before", unit="value")),
    filters=("signal.shown",),
    family="hysteresis",
    order=730,
)
