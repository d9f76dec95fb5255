"""Inertia of a motor's rotor behind its gear, as the joint feels it.

B_j = B + J N^2
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def geared(inertia, reflected):
    """Inertia [kg m2]."""
    return inertia + reflected


EFFECT = Effect(
    id="arm.rotor_inertia",
    summary="inertia of the rotor behind its gear",
    signature="effort off in proportion to the joint's own acceleration, whatever the posture",
    source="N^2 J: 0.01-3 kg m2 for gears of 50-160; range assumed",
    at={"arm.geared": geared},
    parameters=(EffectParameter("inertia", "kg m2", null=0.0, low=0.01, high=3.0, axis=JOINTS, default=0.1),),
    family="inertia",
)
