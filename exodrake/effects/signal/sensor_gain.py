"""Scale error of a load cell.

F = (1 + gain) T
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def reading(tension, clock, gain):
    """Tension as read [N]."""
    return tension * (1.0 + gain)


EFFECT = Effect(
    id="sensor.gain",
    summary="scale error of the load cell",
    signature="reading off in proportion to tension, without a loop",
    source="physics.md 4.C; 1-5 %",
    at={"sensor.reading": reading},
    parameters=(EffectParameter("gain", "-", null=0.0, low=-0.2, high=0.2, axis=TENDONS, default=0.05),),
    family="gain",
    same_meaning=True,
    order=335,
)
