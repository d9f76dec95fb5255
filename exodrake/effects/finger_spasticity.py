"""Resists flexion above a speed.

tau_p = ... + gain max(0, q' - threshold)
"""

from exodrake.core.effect import Effect, Number
from exodrake.core.signal import JOINTS


def passive(torque, bend, rate, elastic, clock, gain, threshold):
    """Passive torque [N m]."""
    return torque + gain * max(0.0, rate - threshold)


EFFECT = Effect(
    id="finger.spasticity",
    summary="resists flexion above a speed",
    signature="flexion held back at speed, extension and slow motion as nominal",
    source="physics.md 4.D; velocity threshold of the stretch reflex [A]",
    at={"finger.passive": passive},
    numbers=(
        Number("gain", "N m s/rad", neutral=0.0, low=1e-3, high=5e-2, over=JOINTS, usual=0.01),
        Number("threshold", "rad/s", neutral=0.5, low=0.0, high=3.0, over=JOINTS, usual=0.5),
    ),
)
