"""Friction at the sensing pulley, where the wire turns round by pi: the reading depends on direction.

F = T (1 + exp(-mu pi z)) / 2        dz/ds = (1 - z sgn(s')) / presliding       z -> +1 while the spool takes wire in

The vocabulary's law and the reference simulator's: an error of the reading alone, with the wire's tension T on both
sides. The pulley that takes its work from the motor is `sensor.pulley_capstan`.
"""

from math import exp, pi

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.friction.bristle import bent


def felt(tension, slide, mu, presliding, bristle):
    """Load on the cell, as tension [N]."""
    return 0.5 * tension * (1.0 + exp(-mu * pi * bristle))


def settle(dt, load, cell, travel, mu, presliding, bristle):
    """Bristle [-1 .. 1]."""
    return bent(bristle, travel, presliding)


EFFECT = Effect(
    id="sensor.pulley_friction",
    summary="friction at the sensing pulley: the reading depends on direction",
    signature="reading turns over in proportion to tension once the spool reverses; rate-free",
    source="physics.md 4.C; 1-5 %; presliding travel assumed",
    at={"sensor.felt": felt, "sensor.settle": settle},
    parameters=(
        EffectParameter("mu", "-", null=0.0, low=0.003, high=0.15, axis=TENDONS, default=0.04),
        EffectParameter("presliding", "m", null=5e-5, low=1e-5, high=2e-3, axis=TENDONS, default=5e-5, transform="log"),
    ),
    states=(State("bristle", TENDONS),),
    advances=("sensor.settle",),
    family="friction",
    order=305,
)
