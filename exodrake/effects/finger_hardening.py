"""Cubic stiffening of the joints.

tau_p = kappa (q - q0) + coefficient (q - q0)^3 + end stops
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def passive(torque, bend, rate, elastic, clock, coefficient):
    """Passive torque [N m]."""
    return torque + coefficient * bend * bend * bend


EFFECT = Effect(
    id="finger.hardening",
    summary="cubic stiffening of the joints",
    signature="angle falls short at large flexion only, without a loop",
    source="physics.md 4.D, k0 + k1 (q - q0)^2 [A]",
    at={"finger.passive": passive},
    parameters=(EffectParameter("coefficient", "N m/rad3", null=0.0, low=0.003, high=0.2, axis=JOINTS, default=0.04),),
    family="elasticity",
    order=420,
)
