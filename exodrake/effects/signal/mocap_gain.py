"""Skin-marker artefact: angles scaled.

q as seen = (1 + gain) q
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def seen(angle, gain):
    """Angle as the markers show it [rad]."""
    return angle * (1.0 + gain)


EFFECT = Effect(
    id="mocap.gain",
    summary="skin-marker artefact: angles scaled",
    signature="angle error proportional to angle; tension and stroke untouched",
    source="physics.md 4.G; slopes 0.98 PIP, 0.892 DIP against CT [S:Metcalf]",
    at={"mocap.seen": seen},
    parameters=(EffectParameter("gain", "-", null=0.0, low=-0.25, high=0.25, axis=JOINTS, default=-0.1),),
    family="gain",
    same_meaning=True,
    order=705,
)
