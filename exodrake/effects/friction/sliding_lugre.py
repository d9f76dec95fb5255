"""LuGre friction: presliding, break-away, Stribeck's fall and damping of the bristle in one law.

F_net = F - sigma_0 z - sigma_1 z'          sigma_0 = force / presliding          z of `friction.lugre`

The part sigma_2 v is `sliding.viscous_friction`.
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.effects.friction.lugre import deflected
from exodrake.effects.friction.stribeck import level


def pushed(drive_force, speed, force, ratio, stribeck_speed, presliding, damping, z):
    """Force on the part [N]."""
    stiffness = force / presliding
    rate = speed - stiffness * abs(speed) * z / level(speed, force, ratio, stribeck_speed)
    return drive_force - stiffness * z - damping * rate


def settle(dt, travel, force, ratio, stribeck_speed, presliding, damping, z):
    """Deflection of the bristle [m]."""
    return deflected(z, travel, level(travel / dt, force, ratio, stribeck_speed), force / presliding)


EFFECT = Effect(
    id="sliding.lugre",
    summary="LuGre friction",
    signature="as dry friction that builds up over the first travel, with a break-away peak and damping in presliding",
    source="Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE T-AC 40(3), 1995; ranges assumed",
    at={"sliding.pushed": pushed, "sliding.settle": settle},
    parameters=(
        EffectParameter("force", "force", null=0.0, low=0.13, high=4.0, default=1.0),
        EffectParameter("ratio", "-", null=1.0, low=1.0, high=2.0, default=1.4),
        EffectParameter("speed", "speed", null=0.1, low=0.02, high=1.0, default=0.1, transform="log"),
        EffectParameter("presliding", "length", null=1e-3, low=2e-4, high=1e-2, default=1e-3, transform="log"),
        EffectParameter("damping", "force/speed", null=1.0, low=0.1, high=10.0, default=1.0, transform="log"),
    ),
    states=(State("deflection", unit="length"),),
    advances=("sliding.settle",),
    family="friction",
    not_tried="five parameters; dry friction with a peak or with presliding, which it joins, is tried",
    order=132,
)
