"""A sensor's clock that runs fast (skew > 0) or slow.

shown(t) = value(t - skew t)          as far back as eight samples
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.effects.signal.late import DEPTH, delayed


def shown(value, clock, period, skew, h0, h1, h2, h3, h4, h5, h6, h7):
    """Value as shown, then the samples remembered."""
    samples = skew * clock / period if period > 0.0 else 0.0
    return delayed(value, clock, samples, (h0, h1, h2, h3, h4, h5, h6, h7))


EFFECT = Effect(
    id="signal.clock_skew",
    summary="the sensor's clock runs fast or slow",
    signature="reading error proportional to rate and growing along the log",
    source="1-100 ppm for crystals, far more for a software clock; range assumed",
    at={"signal.shown": shown},
    parameters=(EffectParameter("skew", "s/s", null=0.0, low=-5e-3, high=5e-3, default=2e-3),),
    states=(State("history", width=DEPTH, unit="value"),),
    filters=("signal.shown",),
    family="delay",
    same_meaning=True,
    order=762,
)
