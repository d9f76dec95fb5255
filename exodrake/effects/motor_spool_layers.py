"""Each full layer of wire raises the spool's radius by a step; the encoder still counts with the nominal one.

r = r0 (1 + growth m)          s = spool + growth (m spool - pitch m (m + 1) / 2)          m = floor(spool / pitch) >= 0
"""

from math import floor

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def layers(spool, pitch):
    """Full layers on the spool [-]."""
    return max(floor(spool / pitch), 0.0)


def wound(spool, growth, pitch):
    """Wire on the spool [m], from r theta [m]."""
    full = layers(spool, pitch)
    return spool + growth * full * (spool - 0.5 * pitch * (full + 1.0))


def winding(speed, spool, growth, pitch):
    """Speed of the wire [m/s], from r theta'."""
    return speed * (1.0 + growth * layers(spool, pitch))


def load(tension, spool, growth, pitch):
    """Tension felt at the nominal radius [N]."""
    return tension * (1.0 + growth * layers(spool, pitch))


EFFECT = Effect(
    id="motor.spool_layers",
    summary="each full layer of wire raises the spool's radius by a step",
    signature="slope of true against counted stroke steps up where a layer is full, in both directions alike",
    source="physics.md 4.A; 3-7 % per layer; a finger takes in 22 mm at most",
    at={"motor.wound": wound, "motor.winding": winding, "motor.load": load},
    parameters=(
        EffectParameter("growth", "-", null=0.0, low=0.01, high=0.15, axis=TENDONS, default=0.06),
        EffectParameter("pitch", "m", null=0.008, low=0.003, high=0.012, axis=TENDONS, default=0.008, transform="log"),
    ),
    family="geometry",
    not_tried="another law of motor.spool_growth, which is tried",
    order=140,
)
