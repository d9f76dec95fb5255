"""Passive stiffness scaled: another wearer, another day.

tau_p = factor kappa (q - q0) + end stops
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def passive(torque, bend, rate, elastic, clock, factor):
    """Passive torque [N m]."""
    return torque + (factor - 1.0) * elastic


EFFECT = Effect(
    id="finger.stiffness",
    summary="passive stiffness scaled (another wearer, another day)",
    signature="angle error proportional to deflection, without a loop; tension and stroke at given angle are off alike",
    source="physics.md 4.D; +-30 % between wearers and more with spasticity [S:SECA]",
    at={"finger.passive": passive},
    parameters=(
        EffectParameter("factor", "-", null=1.0, low=0.4, high=2.5, axis=JOINTS, default=1.4, transform="log"),
    ),
    family="elasticity",
    same_meaning=True,
    order=415,
)
