"""The wearer pushes along, steadily or more and more.

tau_i = torque_i (1 + growth_i t)
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def external(outside, angle, rate, bones, clock, torque, growth):
    """Torques on the joints [N m]."""
    first = torque[0] * (1.0 + growth[0] * clock)
    second = torque[1] * (1.0 + growth[1] * clock)
    return outside[0] + first, outside[1] + second, outside[2] + torque[2] * (1.0 + growth[2] * clock)


EFFECT = Effect(
    id="finger.voluntary_torque",
    summary="the wearer pushes along",
    signature="angle offset that depends neither on tension nor on rate, steady or growing along the log",
    source="physics.md 4.D; 1-50 mN m",
    at={"finger.external": external},
    parameters=(
        EffectParameter("torque", "N m", null=0.0, low=-0.02, high=0.02, axis=JOINTS, default=6e-3),
        EffectParameter("growth", "1/s", null=0.0, low=-0.03, high=0.1, axis=JOINTS, default=0.0),
    ),
    family="disturbance",
    not_tried="rare: the wearer's own course of torque, which takes up any slow error; finger.gravity is tried",
    order=465,
)
