"""Friction at the sensing pulley with its work: the motor pulls harder than the finger is pulled.

    T_spool = T exp(mu pi slide)          F = (T_spool + T) / 2 = T_spool (1 + exp(-mu pi slide)) / 2

T is the tension of the wire beyond the pulley; slide -> +1 while the spool takes wire in, -1 while it gives wire back.
The far side carries exp(-mu pi) of the near side, and the motor does the work (T_spool - T) ds that the pulley takes.
"""

from math import exp, pi

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.friction.bristle import clipped

PRESLIDING = 5e-5  # wire travel over which the friction turns round [m]; assumed, as in systems.sensor


def at_spool(tension, mu, slide, stretch_before):
    """Tension at the spool [N]."""
    return tension * exp(mu * pi * slide)


def at_cell(tension, mu, slide, stretch_before):
    """Load on the cell, as tension [N]: the mean of both strands."""
    return 0.5 * tension * (1.0 + exp(mu * pi * slide))


def settle(dt, stretched, tension, tension_finger, travel, mu, slide, stretch_before):
    """Slide [-1 .. 1] after the wire at the spool moved, and the stretch it has seen [m]."""
    return clipped(slide, travel + stretched - stretch_before, PRESLIDING), stretched


EFFECT = Effect(
    id="sensor.pulley_capstan",
    summary="friction at the sensing pulley, whose work the motor does",
    signature="the finger gets less than the reading says while the spool pulls and more while it gives; rate-free",
    source="physics.md 4.C; capstan equation over half a turn; 1-5 %",
    at={"tendon.at_spool": at_spool, "tendon.at_cell": at_cell, "tendon.settle": settle},
    parameters=(EffectParameter("mu", "-", null=0.0, low=0.003, high=0.15, axis=TENDONS, default=0.04),),
    states=(State("slide", TENDONS), State("stretch_before", TENDONS, unit="m")),
    advances=("tendon.settle",),
    family="friction",
    not_tried="another law of sensor.pulley_friction, which is tried",
    order=260,
)
