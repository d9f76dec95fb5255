"""Dry friction at the rotor: brushes and bearings.

torque on the rotor = r T_c / N + torque z          z: bristle over WIDTH of rotor angle
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.friction.bristle import bent

WIDTH = 1.0  # rotor angle over which the friction turns round [rad]; assumed


def drag(load, torque, bristle):
    """Torque on the rotor [N m]."""
    return load + torque * bristle


def settle(dt, rotor_speed, torque, bristle):
    """Bristle [-1 .. 1]."""
    return bent(bristle, rotor_speed * dt, WIDTH)


EFFECT = Effect(
    id="motor.friction",
    summary="dry friction at the rotor",
    signature="stroke sticks and slips against the speed command near standstill, whatever the load",
    source="physics.md 3.1; 0.08 mN m [S:F1524], 0.74 N at the wire",
    at={"motor.drag": drag, "motor.settle": settle},
    parameters=(EffectParameter("torque", "N m", null=0.0, low=2e-5, high=1e-3, axis=TENDONS, default=3e-4),),
    states=(State("bristle", TENDONS),),
    advances=("motor.settle",),
    family="friction",
    not_tried="the drive's speed loop hides it from stroke and tension; motor.dead_zone is tried",
    order=125,
)
