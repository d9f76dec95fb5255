"""Zero error of a load cell.

F = T + offset
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def reading(tension, clock, offset):
    """Tension as read [N]."""
    return tension + offset


EFFECT = Effect(
    id="sensor.offset",
    summary="zero error of the load cell",
    signature="reading off by the same amount at every tension, a slack wire included",
    source="physics.md 4.C; 0.05-0.5 N",
    at={"sensor.reading": reading},
    parameters=(EffectParameter("offset", "N", null=0.0, low=-1.5, high=1.5, axis=TENDONS, default=0.2),),
    family="offset",
    same_meaning=True,
    order=340,
)
