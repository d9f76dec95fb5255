"""Skin slides over the bone most at half flexion.

q as seen = q + slip sin(2 q)
"""

from math import sin

from exodrake.core.effect import ANY_SHAPE, Effect, EffectParameter
from exodrake.core.signal import JOINTS


def seen(angle, slip):
    """Angle as the markers show it [rad]."""
    return angle + slip * sin(2.0 * angle)


EFFECT = Effect(
    id="mocap.skin_artefact",
    summary="skin slides over the bone most at half flexion",
    signature="angle error curved over angle, greatest near 45 degrees; tension and stroke untouched",
    source="physics.md 4.G; below 4 deg [S:Metcalf]",
    at={"mocap.seen": seen},
    parameters=(EffectParameter("slip", "rad", null=0.0, low=-0.1, high=0.1, axis=JOINTS, default=0.03),),
    family="nonlinearity",
    law_std=ANY_SHAPE,
    not_tried="another law of mocap.gain, which is tried",
    order=710,
)
