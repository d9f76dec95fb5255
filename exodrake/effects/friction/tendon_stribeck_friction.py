"""Coulomb friction with a higher level near standstill.

    T_d = T_c - level(v) slide          level(v) = force (1 + (ratio - 1) exp(-(v / v_s)^2))

The level follows the speed with a short frictional memory (frictional lag: Armstrong-Helouvry et al., Automatica
30(7), 1994): a level that fell at once with speed would be a negative damper that no fixed step survives.
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.friction.stribeck import level
from exodrake.effects.relaxation import relaxed

MEMORY = 4e-3  # time constant of the frictional memory [s]; assumed


def transmit(tension, slide, travel, speed, force, ratio, stribeck_speed, remembered):
    """Tension at the finger [N]."""
    return tension - level(remembered, force, ratio, stribeck_speed) * slide


def settle(dt, stretched, tension, tension_finger, travel, force, ratio, stribeck_speed, remembered):
    """Remembered speed [m/s]."""
    return relaxed(remembered, travel / dt, dt, MEMORY)


EFFECT = Effect(
    id="tendon.stribeck_friction",
    summary="Coulomb friction with a higher level near standstill",
    signature="as Coulomb friction, but the loop is wider at slow motion; break-away peaks, stick-slip",
    source="physics.md 4.B; static over sliding 1-1.5, 1-5 mm/s",
    at={"tendon.transmit": transmit, "tendon.settle": settle},
    parameters=(
        EffectParameter("force", "N", null=0.0, low=0.05, high=1.5, axis=TENDONS, default=0.3),
        EffectParameter("ratio", "-", null=1.0, low=1.1, high=3.0, axis=TENDONS, default=2.0),
        EffectParameter("speed", "m/s", null=0.005, low=0.001, high=0.03, axis=TENDONS, default=0.005, transform="log"),
    ),
    states=(State("remembered", TENDONS, unit="m/s"),),
    advances=("tendon.settle",),
    family="friction",
    order=240,
)
