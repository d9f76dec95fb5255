"""Zero error of a reading.

shown = value + offset
"""

from exodrake.core.effect import Effect, EffectParameter


def shown(value, clock, period, offset):
    """Value as shown."""
    return value + offset


EFFECT = Effect(
    id="signal.offset",
    summary="zero error of the reading",
    signature="reading off by the same amount at every value",
    source="homing, marker frames, amplifiers; range assumed",
    at={"signal.shown": shown},
    parameters=(EffectParameter("offset", "value", null=0.0, low=-0.3, high=0.3, default=0.05),),
    family="offset",
    same_meaning=True,
    order=742,
)
