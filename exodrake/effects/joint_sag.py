"""A servo gives way under the weight that it carries: it holds by an angle error times its stiffness.

aim = command + sag cos(command)          sag: weight's torque of the level link over the servo's stiffness
"""

from math import cos

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def aimed(aim, ahead, behind, setting, sag):
    """Angle aimed at [rad]."""
    return aim + sag * cos(aim)


EFFECT = Effect(
    id="joint.gravity_sag",
    summary="the servo gives way under the weight that it carries",
    signature="constant error near one posture, largest with the link level; none in joints with an upright axis",
    source="proportional servos hold by their error; 1-5 deg; range assumed",
    at={"joint.aimed": aimed},
    parameters=(EffectParameter("sag", "rad", null=0.0, low=-0.1, high=0.1, axis=JOINTS, default=0.02),),
    family="load",
)
