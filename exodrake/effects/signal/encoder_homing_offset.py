"""Stroke zero in the wrong place: it lies `offset` further in than where the wire is just taut at q = 0.

    stroke as read = s - offset

A robot that starts where its encoder says that the wire is just taut starts `offset` further in.
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def wound(stroke, offset):
    """Wire on the spool [m] where the encoder counts `stroke` [m]."""
    return stroke + offset


EFFECT = Effect(
    id="encoder.homing_offset",
    summary="stroke zero in the wrong place",
    signature="constant stroke offset at every tension; a negative one is the same as a slack wire",
    source="physics.md 4.A; 0-2 mm; from 3 mm on two wires would start beyond their maximum tension of 8 N",
    at={"motor.wound": wound},
    parameters=(EffectParameter("offset", "m", null=0.0, low=-5e-3, high=2.5e-3, axis=TENDONS, default=1e-3),),
    family="offset",
    same_meaning=True,
    order=605,
)
