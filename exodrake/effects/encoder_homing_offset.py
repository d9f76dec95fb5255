"""Stroke zero in the wrong place: it lies `offset` further in than where the wire is just taut at q = 0.

stroke as read = s - offset
"""

from exodrake.block import WIRES, Effect, Number


def homed(stroke, offset):
    """Stroke as counted [m]."""
    return stroke - offset


EFFECT = Effect(
    id="encoder.homing_offset",
    summary="stroke zero in the wrong place",
    signature="constant stroke offset at every tension, as that of a slack wire where the offset is negative",
    source="physics.md 4.A; 0-2 mm",
    at={"encoder.homed": homed},
    numbers=(Number("offset", "m", neutral=0.0, low=-5e-3, high=5e-3, over=WIRES, usual=1e-3),),
)
