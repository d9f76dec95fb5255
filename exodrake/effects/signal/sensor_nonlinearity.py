"""Parabolic error of a load cell, zero at 0 and full scale.

F = T + error T (T_s - T) / (T_s / 2)^2          T_s = 20 N full scale of tension
"""

from exodrake.core.effect import ANY_SHAPE, Effect, EffectParameter
from exodrake.core.signal import TENDONS

FULL_SCALE = 20.0  # tension at which the cell is full [N]; effects.md


def reading(tension, clock, error):
    """Tension as read [N]."""
    half = 0.5 * FULL_SCALE
    return tension + error * tension * (FULL_SCALE - tension) / (half * half)


EFFECT = Effect(
    id="sensor.nonlinearity",
    summary="parabolic error of the load cell, zero at 0 and full scale (20 N)",
    signature="reading error curved over tension, greatest at mid range, without a loop",
    source="physics.md 4.C; 0.1 N at mid range",
    at={"sensor.reading": reading},
    parameters=(EffectParameter("error", "N", null=0.0, low=-1.0, high=1.0, axis=TENDONS, default=0.2),),
    family="nonlinearity",
    law_std=ANY_SHAPE,
    order=330,
)
