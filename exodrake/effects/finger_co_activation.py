"""The wearer tenses flexors and extensors in bouts: the joints stiffen and soften again.

tau_p = kappa (q - q0) (1 + gain (1 - cos(2 pi frequency t)) / 2) + end stops
"""

from math import cos, pi

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS, SCALAR


def passive(torque, bend, rate, elastic, clock, gain, frequency):
    """Passive torque [N m]."""
    return torque + 0.5 * gain * elastic * (1.0 - cos(2.0 * pi * frequency * clock))


EFFECT = Effect(
    id="finger.co_activation",
    summary="the wearer tenses flexors and extensors in bouts",
    signature="angle error proportional to deflection that comes and goes at a slow frequency of its own",
    source="physics.md 4.D; stiffness up to threefold in activity",
    at={"finger.passive": passive},
    parameters=(
        EffectParameter("gain", "-", null=0.0, low=0.05, high=2.0, axis=JOINTS, default=0.5),
        EffectParameter("frequency", "Hz", null=0.2, low=0.02, high=2.0, axis=SCALAR, default=0.2, transform="log"),
    ),
    family="disturbance",
    not_tried="rare: the wearer's own course of stiffness; finger.stiffness is tried",
    order=425,
)
