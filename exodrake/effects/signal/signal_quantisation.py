"""A reading in coarser steps than stated.

shown = step round(value / step)
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.physics.rounding import rounded


def delivered(value, held, arrival, step):
    """Value as delivered."""
    return rounded(value, step)


EFFECT = Effect(
    id="signal.quantisation",
    summary="reading in coarser steps than stated",
    signature="readings are multiples of one step; error uniform within half of it",
    source="resolution of encoders and converters; range assumed",
    at={"signal.delivered": delivered},
    parameters=(EffectParameter("step", "value", null=0.0, low=0.005, high=0.1, default=0.02),),
    family="quantisation",
    not_tried="rounding is noise to a fit; the values of the readings show it, and the resolution is a parameter",
    order=780,
)
