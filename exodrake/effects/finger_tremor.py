"""Oscillating voluntary torque.

tau_i = torque_i sin(2 pi frequency t)
"""

from math import pi, sin

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS, SCALAR


def external(outside, angle, rate, bones, clock, torque, frequency):
    """Torques on the joints [N m]."""
    wave = sin(2.0 * pi * frequency * clock)
    return outside[0] + torque[0] * wave, outside[1] + torque[1] * wave, outside[2] + torque[2] * wave


EFFECT = Effect(
    id="finger.tremor",
    summary="oscillating voluntary torque",
    signature="spectral line in angle and tension at one frequency, whatever the reference does",
    source="physics.md 4.D; 6-12 Hz [S:Lakie], displacement mostly 1-3.5 Hz [S:Carignan]",
    at={"finger.external": external},
    parameters=(
        EffectParameter("torque", "N m", null=0.0, low=5e-4, high=3e-2, axis=JOINTS, default=6e-3),
        EffectParameter("frequency", "Hz", null=4.0, low=1.0, high=12.0, axis=SCALAR, default=4.0, transform="log"),
    ),
    family="disturbance",
    detector="spectral_peak",
    order=460,
)
