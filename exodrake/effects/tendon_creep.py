"""Delayed elongation of the wire (standard linear solid).

T_c = k (s - l - y)          time_constant y' = T_c / stiffness - y
"""

from math import inf

from exodrake.core.effect import Effect, Number
from exodrake.core.part import State
from exodrake.core.signal import WIRES
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
    numbers=(
        Number("stiffness", "N/m", neutral=inf, low=1500.0, high=6e4, over=WIRES, usual=8000.0, scale="reciprocal"),
        Number("time_constant", "s", neutral=10.0, low=0.5, high=100.0, over=WIRES, usual=10.0, scale="log"),
    ),
    states=(State("elongation", WIRES, unit="m"),),
    advances=("tendon.settle",),
)
