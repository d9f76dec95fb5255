"""Marker frames misaligned.

q as seen = q + offset
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def seen(angle, offset):
    """Angle as the markers show it [rad]."""
    return angle + offset


EFFECT = Effect(
    id="mocap.offset",
    summary="marker frames misaligned",
    signature="constant angle error; tension and stroke untouched",
    source="physics.md 4.G; 1-5 deg",
    at={"mocap.seen": seen},
    parameters=(EffectParameter("offset", "rad", null=0.0, low=-0.2, high=0.2, axis=JOINTS, default=0.05),),
    family="offset",
    same_meaning=True,
    order=715,
)
