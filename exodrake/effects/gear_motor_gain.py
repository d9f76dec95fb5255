"""Torque constant or gear ratio other than stated: the joint gets another effort than the current stands for.

tau_j = (1 + gain) k_t N i
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def driven(effort, gain):
    """Effort on the joint [N m]."""
    return (1.0 + gain) * effort


EFFECT = Effect(
    id="gear_motor.torque_gain",
    summary="torque constant or gear ratio other than stated",
    signature="effort needed off in proportion to itself on one joint, at rest as in motion",
    source="magnets and their temperature, 5-20 %; range assumed",
    at={"gear_motor.driven": driven},
    parameters=(EffectParameter("gain", "-", null=0.0, low=-0.4, high=0.4, axis=JOINTS, default=-0.1),),
    family="gain",
)
