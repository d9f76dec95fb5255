"""Routers sit higher or lower than drawn, on both sides of the joint.

h = h_drawn + height
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def router_height(drawn, height):
    """Router height [m]."""
    return drawn + height


EFFECT = Effect(
    id="finger.router_height",
    summary="routers sit higher or lower than drawn",
    signature="wrong moment arms: angle against stroke has another slope, angle against tension another gain; no loop",
    source="physics.md 4.D; 0.5-2 mm",
    at={"wire_paths.router_height": router_height},
    parameters=(EffectParameter("height", "m", null=0.0, low=-1.5e-3, high=2e-3, axis=JOINTS, default=5e-4),),
    family="geometry",
    order=405,
)
