"""Gear or pulley ratio of a joint differs from the configured one.

aim = (1 + gain) command
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def aimed(aim, ahead, behind, setting, gain):
    """Angle aimed at [rad]."""
    return (1.0 + gain) * aim


EFFECT = Effect(
    id="joint.gain",
    summary="the joint goes further or less far than commanded",
    signature="error proportional to the command, no loop",
    source="pulley radii and elastic cables; range assumed",
    at={"joint.aimed": aimed},
    parameters=(EffectParameter("gain", "-", null=0.0, low=-0.3, high=0.3, axis=JOINTS, default=-0.1),),
    family="gain",
    same_meaning=True,
)
