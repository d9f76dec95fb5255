"""Delayed elongation of the wire (standard linear solid).

T_c = k (s - l - y)          time_constant y' = T_c / stiffness - y
"""

from math import inf

from exodrake.core.effect import ANY_SHAPE, Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.relaxation import relaxed


def stretch(extension, tension_finger, stiffness, time_constant, elongation):
    """Elastic stretch [m]."""
    return extension - elongation


def settle(dt, stretched, tension, tension_finger, travel, stiffness, time_constant, elongation):
    """Delayed elongation [m]."""
    return relaxed(elongation, tension / stiffness, dt, time_constant)


EFFECT = Effect(
    id="tendon.creep",
    summary="delayed elongation of the wire (standard linear solid)",
    signature="stroke drifts at held tension and remembers load; loop of angle against stroke, smaller in fast motion",
    source="physics.md 4.B; 10-40 % of the elastic stretch, 1-300 s",
    at={"tendon.stretch": stretch, "tendon.settle": settle},
    parameters=(
        EffectParameter(
            "stiffness", "N/m", null=inf, low=1500.0, high=6e4, axis=TENDONS, default=8000.0, transform="reciprocal"
        ),
        EffectParameter(
            "time_constant", "s", null=10.0, low=0.5, high=100.0, axis=TENDONS, default=10.0, transform="log"
        ),
    ),
    states=(State("elongation", TENDONS, unit="m"),),
    advances=("tendon.settle",),
    family="viscoelasticity",
    law_std=ANY_SHAPE,
    order=210,
)
