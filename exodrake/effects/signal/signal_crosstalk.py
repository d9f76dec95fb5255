"""A sensor that picks up its neighbour's value.

shown_j = value_j + coefficient value_(j+1)          the last channel is followed by the first
"""

from exodrake.core.effect import Effect, EffectParameter


def mixed(value, other, coefficient):
    """Value that the sensor sees."""
    return value + coefficient * other


EFFECT = Effect(
    id="signal.crosstalk",
    summary="a sensor picks up its neighbour's value",
    signature="reading error proportional to another channel",
    source="cables, shared supplies, structures; 0.1-10 %; range assumed",
    at={"signal.mixed": mixed},
    parameters=(EffectParameter("coefficient", "-", null=0.0, low=-0.3, high=0.3, default=0.05),),
    family="crosstalk",
    same_meaning=True,
    order=720,
)
