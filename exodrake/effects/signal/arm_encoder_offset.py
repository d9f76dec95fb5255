"""Zero of a joint's encoder in the wrong place: the arm stands elsewhere than measured.

q_j = measured + offset
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def seen(position, offset):
    """Position of the joint [rad]."""
    return position + offset


EFFECT = Effect(
    id="arm.encoder_offset",
    summary="zero of a joint's encoder in the wrong place",
    signature="efforts of gravity off by a constant angle: a sine of the posture, on this joint and those before it",
    source="homing; range assumed",
    at={"arm.seen": seen},
    parameters=(EffectParameter("offset", "rad", null=0.0, low=-0.3, high=0.3, axis=JOINTS, default=0.05),),
    family="offset",
)
