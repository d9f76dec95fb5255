"""Friction at the sensing pulley, where the wire turns round by pi: the reading depends on direction.

F = T (1 + exp(-mu pi slide)) / 2        slide -> +1 while the spool takes wire in, -1 while it gives wire back

The vocabulary's law and the reference simulator's: an error of the reading alone, with the wire's tension T on both
sides. The pulley that takes its work from the motor is `sensor.pulley_capstan`.
"""

from math import exp, pi

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def felt(tension, slide, mu):
    """Load on the cell, as tension [N]."""
    return 0.5 * tension * (1.0 + exp(-mu * pi * slide))


EFFECT = Effect(
    id="sensor.pulley_friction",
    summary="friction at the sensing pulley: the reading depends on direction",
    signature="reading jumps in proportion to tension where the spool reverses; rate-free",
    source="physics.md 4.C; 1-5 %",
    at={"sensor.felt": felt},
    parameters=(EffectParameter("mu", "-", null=0.0, low=0.003, high=0.15, axis=TENDONS, default=0.04),),
    family="friction",
    order=305,
)
