"""LuGre friction on the wire, between cell and finger: presliding, break-away, Stribeck's fall and damping in one law.

T_d = T_c - F(v, z)          F of `friction.lugre`, v > 0 while the finger takes wire in

The part sigma_2 v is `tendon.viscous_friction`.
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.friction.grip import gripped, kept
from exodrake.effects.friction.lugre import deflected, force
from exodrake.effects.friction.stribeck import level


def gripped_to(z, tension, most):
    """Deflection [m] that a wire under this tension [N] holds, `most` of a taut one."""
    return most * kept(z / most, tension)


def transmit(tension, slide, travel, speed, coulomb, ratio, stribeck_speed, stiffness, damping, z):
    """Tension at the finger [N]."""
    after = deflected(z, travel, level(speed, coulomb, ratio, stribeck_speed), stiffness)
    damped = force(z, after, travel, speed, 0.0, gripped(damping, tension))
    return tension - damped - stiffness * gripped_to(after, tension, ratio * coulomb / stiffness)


def settle(dt, stretched, tension, tension_finger, travel, coulomb, ratio, stribeck_speed, stiffness, damping, z):
    """Deflection of the bristle [m]."""
    after = deflected(z, travel, level(travel / dt, coulomb, ratio, stribeck_speed), stiffness)
    return gripped_to(after, tension, ratio * coulomb / stiffness)


EFFECT = Effect(
    id="tendon.lugre",
    summary="LuGre friction: presliding, break-away peak and damping of the bristle",
    signature="loop of angle against tension that opens gradually after a reversal and is wider at slow motion",
    source="Canudas de Wit et al., IEEE T-AC 40(3), 1995; physics.md 4.B; ranges assumed",
    at={"tendon.transmit": transmit, "tendon.settle": settle},
    parameters=(
        EffectParameter("force", "N", null=0.0, low=0.05, high=1.5, axis=TENDONS, default=0.4),
        EffectParameter("ratio", "-", null=1.0, low=1.0, high=2.0, axis=TENDONS, default=1.4),
        EffectParameter("speed", "m/s", null=0.005, low=0.002, high=0.03, axis=TENDONS, default=0.005, transform="log"),
        EffectParameter(
            "stiffness", "N/m", null=1000.0, low=100.0, high=1e4, axis=TENDONS, default=1000.0, transform="log"
        ),
        EffectParameter("damping", "N s/m", null=5.0, low=0.5, high=20.0, axis=TENDONS, default=5.0, transform="log"),
    ),
    states=(State("deflection", TENDONS, unit="m"),),
    advances=("tendon.settle",),
    family="friction",
    not_tried="another law of tendon.stribeck_friction, which is tried",
    order=248,
)
