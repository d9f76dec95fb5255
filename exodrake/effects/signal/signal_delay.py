"""A reading that comes late, by whole samples or by a fraction of one.

shown(n) = value(n - delay / period)          between samples the two neighbours are mixed
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.effects.signal.late import DEPTH, delayed


def shown(value, clock, period, delay, h0, h1, h2, h3, h4, h5, h6, h7):
    """Value as shown, then the samples remembered."""
    samples = delay / period if period > 0.0 else 0.0
    return delayed(value, clock, samples, (h0, h1, h2, h3, h4, h5, h6, h7))


EFFECT = Effect(
    id="signal.delay",
    summary="reading comes late, by a fraction of a sample or more",
    signature="reading error proportional to rate: phase without loss of magnitude; nothing at rest",
    source="transport and bus; range assumed",
    at={"signal.shown": shown},
    parameters=(EffectParameter("delay", "period", null=0.0, low=0.05, high=6.0, default=0.8),),
    states=(State("history", width=DEPTH, unit="value"),),
    filters=("signal.shown",),
    family="delay",
    same_meaning=True,
    order=760,
)
