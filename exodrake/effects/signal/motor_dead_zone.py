"""Drive ignores small speed commands.

v = v_ref from where |v_ref| exceeds width, until |v_ref| falls below release width; 0 else

What makes a drive stand still, static friction or a threshold, lets go of it at a smaller command than it takes to
start.
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS


def follow(dt, speed, loop_time, width, release, moving):
    """1 while the drive moves, else 0."""
    threshold = width * release if moving > 0.5 else width
    return 0.0 if abs(speed) < threshold else 1.0


def command(speed, tension, width, release, moving):
    """Speed that the drive follows [m/s]."""
    return speed * moving


EFFECT = Effect(
    id="motor.dead_zone",
    summary="drive ignores small speed commands",
    signature="tension stays off its reference by up to width over kp; no motion below the threshold, limit cycles",
    source="physics.md 4.A; 0-2 mm/s [A]; release: 4.B, static over sliding friction 1-1.5",
    at={"motor.follow": follow, "motor.command": command},
    parameters=(
        EffectParameter("width", "m/s", null=0.0, low=2e-4, high=4e-3, axis=TENDONS, default=1e-3),
        EffectParameter("release", "-", null=1.0, low=0.5, high=1.0, axis=TENDONS, default=0.8),
    ),
    states=(State("moving", TENDONS),),
    advances=("motor.follow",),
    family="dead zone",
    order=110,
)
