"""Zero error of a load cell.

F = T + offset
"""

from exodrake.core.effect import Effect, Number
from exodrake.core.signal import WIRES


def reading(tension, clock, offset):
    """Tension as read [N]."""
    return tension + offset


EFFECT = Effect(
    id="sensor.offset",
    summary="zero error of the load cell",
    signature="reading off by the same amount at every tension, a slack wire included",
    source="physics.md 4.C; 0.05-0.5 N",
    at={"sensor.reading": reading},
    numbers=(Number("offset", "N", neutral=0.0, low=-1.5, high=1.5, over=WIRES, usual=0.2),),
)
