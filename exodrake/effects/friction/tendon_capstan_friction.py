"""Sheath friction proportional to load, between cell and finger (capstan law).

    T_d = T_c - F          T_c (1 - exp(mu_phi)) <= F <= T_c (1 - exp(-mu_phi))          F of `friction.jenkins`

While the finger takes wire in T_d = T_c exp(-mu_phi), while it gives wire back T_d = T_c exp(mu_phi).
"""

from math import exp

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.friction.jenkins import spring, yielded

PRESLIDING = 5e-5  # travel over which the friction turns round at `jenkins.LOAD` [m]; assumed, as tendon.presliding


def rubbed(tension, travel, mu_phi, force):
    """Force of friction [N] after a further travel [m]; tension at the cell's end [N]."""
    low, high = tension * (1.0 - exp(mu_phi)), tension * (1.0 - exp(-mu_phi))
    return yielded(force, travel, spring(mu_phi, PRESLIDING), low, high)


def transmit(tension, slide, travel, speed, mu_phi, force):
    """Tension at the finger [N]."""
    return tension - rubbed(tension, travel, mu_phi, force)


def settle(dt, stretched, tension, tension_finger, travel, mu_phi, force):
    """Force of friction [N]."""
    return rubbed(tension, travel, mu_phi, force)


EFFECT = Effect(
    id="tendon.capstan_friction",
    summary="sheath friction proportional to load, between cell and finger",
    signature="loop of angle against tension whose width grows with load, rate-free; none of angle against stroke",
    source="physics.md 4.B; mu phi 0.1-0.9 from exosuit Bowden efficiency 40-60 % [S:Stillsuit], 60 % [S:TUM]",
    at={"tendon.transmit": transmit, "tendon.settle": settle},
    parameters=(EffectParameter("mu_phi", "-", null=0.0, low=0.05, high=0.9, axis=TENDONS, default=0.3),),
    states=(State("force", TENDONS, unit="N"),),
    advances=("tendon.settle",),
    family="friction",
    order=230,
)
