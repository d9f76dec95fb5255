"""Zero of a reading that wanders with time.

shown = value + rate t          t from the first sample
"""

from exodrake.core.effect import ANY_SHAPE, Effect, EffectParameter


def shown(value, clock, period, rate):
    """Value as shown."""
    return value + rate * clock


EFFECT = Effect(
    id="signal.drift",
    summary="zero of the reading wanders with time",
    signature="reading error that grows with time, not with value or rate",
    source="temperature of sensors and amplifiers; range assumed",
    at={"signal.shown": shown},
    parameters=(EffectParameter("rate", "value/s", null=0.0, low=-0.05, high=0.05, default=0.01),),
    family="drift",
    law_std=ANY_SHAPE,
    order=744,
)
