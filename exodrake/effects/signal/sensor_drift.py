"""Zero of a load cell wanders with time.

F = T + rate t          t from the start of the log
"""

from exodrake.core.effect import ANY_SHAPE, Effect, EffectParameter
from exodrake.core.signal import TENDONS


def reading(tension, clock, rate):
    """Tension as read [N]."""
    return tension + rate * clock


EFFECT = Effect(
    id="sensor.drift",
    summary="zero of the load cell wanders with time",
    signature="reading error grows with time, not with tension or stroke",
    source="physics.md 4.C; temperature and creep, 0.05 % of full scale per 10 K",
    at={"sensor.reading": reading},
    parameters=(EffectParameter("rate", "N/s", null=0.0, low=-0.03, high=0.03, axis=TENDONS, default=0.005),),
    family="drift",
    law_std=ANY_SHAPE,
    order=345,
)
