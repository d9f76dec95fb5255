"""Gear losses proportional to load: the rotor feels more when it winds, less when it is driven back.

felt = T_c efficiency^(-z)          z: bristle over WIDTH of rotor angle, +1 while winding, -1 while unwinding
"""

from math import exp, log

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.friction.bristle import bent

WIDTH = 2.0  # rotor angle over which the losses turn round [rad]; assumed


def load(tension, spool, efficiency, bristle):
    """Tension that the rotor feels [N]."""
    return tension * exp(-log(efficiency) * bristle)


def settle(dt, rotor_speed, efficiency, bristle):
    """Bristle [-1 .. 1]."""
    return bent(bristle, rotor_speed * dt, WIDTH)


EFFECT = Effect(
    id="motor.gear_efficiency",
    summary="gear losses proportional to load",
    signature="speed error against the command jumps with direction under load; the finger's loops untouched",
    source="physics.md 3.1, 4.A; 0.5-0.85 [S:FFAQ]",
    at={"motor.load": load, "motor.settle": settle},
    parameters=(EffectParameter("efficiency", "-", null=1.0, low=0.4, high=0.95, axis=TENDONS, default=0.65),),
    states=(State("bristle", TENDONS),),
    advances=("motor.settle",),
    family="friction",
    not_tried="the drive's speed loop hides it until the current clips; motor.current_limit is tried",
    order=130,
)
