"""Slower filter than nominal in the load cell's amplifier.

time_constant F' = T - F
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def lag(nominal, time_constant):
    """Amplifier's time constant [s]."""
    return max(nominal, time_constant)


EFFECT = Effect(
    id="sensor.lag",
    summary="slower filter than nominal in the load cell's amplifier",
    signature="reading lags in ramps and rounds off steps, alike in both directions; nothing at rest",
    source="physics.md 4.C; 2-50 ms",
    at={"sensor.lag": lag},
    parameters=(EffectParameter("time_constant", "s", null=0.0, low=0.003, high=0.1, axis=TENDONS, default=0.02),),
    family="lag",
    order=315,
)
