"""Friction at the sensing pulley, where the wire turns round by pi; the motor does its work.

    T_spool = T + F          T (exp(-mu pi) - 1) <= F <= T (exp(mu pi) - 1)          F of `friction.jenkins`
    reading = (T_spool + T) / 2

T is the tension of the wire beyond the pulley. While the spool takes wire in T_spool = T exp(mu pi), while it gives
wire back T_spool = T exp(-mu pi): the finger gets less than the reading says, then more.
"""

from math import exp, pi

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.friction.jenkins import spring, yielded


def rubbed(tension, travel, mu, presliding, force):
    """Force of friction [N] after the spool took in a further travel [m]."""
    low, high = tension * (exp(-mu * pi) - 1.0), tension * (exp(mu * pi) - 1.0)
    return yielded(force, travel, spring(mu * pi, presliding), low, high)


def at_spool(tension, mu, presliding, force, stretch_before):
    """Tension at the spool [N]."""
    return tension + rubbed(tension, 0.0, mu, presliding, force)


def at_cell(tension, mu, presliding, force, stretch_before):
    """Load on the cell, as tension [N]: the mean of both strands."""
    return tension + 0.5 * rubbed(tension, 0.0, mu, presliding, force)


def settle(dt, stretched, tension, tension_finger, travel, mu, presliding, force, stretch_before):
    """Force of friction [N] after the wire at the spool moved, and the stretch it has seen [m]."""
    return rubbed(tension, travel + stretched - stretch_before, mu, presliding, force), stretched


EFFECT = Effect(
    id="sensor.pulley_friction",
    summary="friction at the sensing pulley: the reading depends on direction",
    signature="the finger gets less than the reading says while the spool pulls and more while it gives; rate-free",
    source="physics.md 4.C; capstan equation over half a turn, 1-5 %; presliding travel assumed",
    at={"tendon.at_spool": at_spool, "tendon.at_cell": at_cell, "tendon.settle": settle},
    parameters=(
        EffectParameter("mu", "-", null=0.0, low=0.003, high=0.15, axis=TENDONS, default=0.04),
        EffectParameter("presliding", "m", null=5e-5, low=1e-5, high=2e-3, axis=TENDONS, default=5e-5, transform="log"),
    ),
    states=(State("force", TENDONS, unit="N"), State("stretch_before", TENDONS, unit="m")),
    advances=("tendon.settle",),
    family="friction",
    order=305,
)
