"""The cell remembers the way its load has come.

F = T + error z          z: bristle over a width of load
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.friction.bristle import bent


def reading(tension, clock, error, width, bristle, load_before):
    """Tension as read [N]."""
    return tension + error * bristle


def settle(dt, load, cell, travel, error, width, bristle, load_before):
    """Bristle [-1 .. 1] and the load it has seen [N]."""
    return bent(bristle, load - load_before, width), load


EFFECT = Effect(
    id="sensor.hysteresis",
    summary="the cell remembers the way its load has come",
    signature="reading differs between rising and falling tension by an amount independent of stroke and rate",
    source="physics.md 4.C; 0.05-0.2 % of full scale, more for a cheap cell",
    at={"sensor.reading": reading, "sensor.settle": settle},
    parameters=(
        EffectParameter("error", "N", null=0.0, low=-0.5, high=0.5, axis=TENDONS, default=0.1),
        EffectParameter("width", "N", null=1.0, low=0.2, high=5.0, axis=TENDONS, default=1.0, transform="log"),
    ),
    states=(State("bristle", TENDONS), State("load_before", TENDONS, unit="N")),
    advances=("sensor.settle",),
    family="hysteresis",
    not_tried="another law of a direction-dependent reading; sensor.pulley_friction is tried",
    order=325,
)
