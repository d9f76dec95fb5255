"""The cell goes on yielding under load (standard linear solid).

F = T + y          time_constant y' = fraction T - y
"""

from exodrake.core.effect import ANY_SHAPE, Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.relaxation import relaxed


def reading(tension, clock, fraction, time_constant, crept):
    """Tension as read [N]."""
    return tension + crept


def settle(dt, load, cell, travel, fraction, time_constant, crept):
    """Reading by creep [N]."""
    return relaxed(crept, fraction * load, dt, time_constant)


EFFECT = Effect(
    id="sensor.creep",
    summary="the cell goes on yielding under load",
    signature="reading drifts towards load at held tension and comes back late; stroke and angle tell otherwise",
    source="physics.md 4.C; 0.1 % in 30 min for a good cell, per cent for a printed one",
    at={"sensor.reading": reading, "sensor.settle": settle},
    parameters=(
        EffectParameter("fraction", "-", null=0.0, low=0.005, high=0.15, axis=TENDONS, default=0.05),
        EffectParameter(
            "time_constant", "s", null=10.0, low=1.0, high=100.0, axis=TENDONS, default=10.0, transform="log"
        ),
    ),
    states=(State("crept", TENDONS, unit="N"),),
    advances=("sensor.settle",),
    family="viscoelasticity",
    law_std=ANY_SHAPE,
    not_tried="another law of a slow zero error; sensor.drift is tried",
    order=320,
)
