"""Zero of a joint in the wrong place.

aim = command + offset
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def aimed(aim, ahead, behind, setting, offset):
    """Angle aimed at [rad]."""
    return aim + offset


EFFECT = Effect(
    id="joint.offset",
    summary="zero of the joint in the wrong place",
    signature="constant error at every angle",
    source="homing and marker frames; range assumed",
    at={"joint.aimed": aimed},
    parameters=(EffectParameter("offset", "rad", null=0.0, low=-0.3, high=0.3, axis=JOINTS, default=0.05),),
    family="offset",
    same_meaning=True,
)
