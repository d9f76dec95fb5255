"""Resists flexion above a speed.

tau_p = ... + gain max(0, q' - threshold)
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def passive(torque, bend, rate, elastic, clock, gain, threshold):
    """Passive torque [N m]."""
    return torque + gain * max(0.0, rate - threshold)


EFFECT = Effect(
    id="finger.spasticity",
    summary="resists flexion above a speed",
    signature="flexion held back at speed, extension and slow motion as nominal",
    source="physics.md 4.D; velocity threshold of the stretch reflex [A]; a moderate motion reaches 1-2 rad/s",
    at={"finger.passive": passive},
    parameters=(
        EffectParameter("gain", "N m s/rad", null=0.0, low=1e-3, high=5e-2, axis=JOINTS, default=0.01),
        EffectParameter("threshold", "rad/s", null=0.5, low=0.0, high=1.0, axis=JOINTS, default=0.5),
    ),
    family="friction",
    order=440,
)
