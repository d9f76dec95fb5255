"""Slower filter than nominal in the load cell's amplifier.

(1 - filtering) time_constant a' = T - a          filtering time_constant F' = a - F

An amplifier is followed by the filter of its converter, which may be slow as well; both lag by `time_constant`. The
second stage is exact for an amplified tension that is linear over a tick, as the first is, so that `filtering` may fall
to 0 without a jump.
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.physics.sensor import followed


def lag(nominal, time_constant, filtering, filtered, amplified, tick):
    """Amplifier's time constant [s]."""
    return max(nominal, (1.0 - filtering) * time_constant)


def reading(tension, clock, time_constant, filtering, filtered, amplified, tick):
    """Filtered tension of this instant [N]: a tick after that of the states."""
    return followed(filtered, amplified, tension, tick, filtering * time_constant) if tick > 0.0 else tension


def settle(dt, load, cell, travel, time_constant, filtering, filtered, amplified, tick):
    """Filtered and amplified tension [N] at the end of a tick [s]."""
    return followed(filtered, amplified, cell, dt, filtering * time_constant), cell, dt


EFFECT = Effect(
    id="sensor.lag",
    summary="slower filter than nominal in the load cell's amplifier",
    signature="reading lags in ramps and rounds off steps, alike in both directions; nothing at rest",
    source="physics.md 4.C; 2-50 ms; share of the converter's filter assumed",
    at={"sensor.lag": lag, "sensor.reading": reading, "sensor.settle": settle},
    parameters=(
        EffectParameter("time_constant", "s", null=0.0, low=0.003, high=0.1, axis=TENDONS, default=0.02),
        EffectParameter("filtering", "-", null=0.2, low=0.02, high=0.5, axis=TENDONS, default=0.2),
    ),
    states=(
        State("filtered", TENDONS, unit="N"),
        State("amplified", TENDONS, unit="N"),
        State("tick", TENDONS, unit="s"),
    ),
    advances=("sensor.settle",),
    family="lag",
    order=315,
)
