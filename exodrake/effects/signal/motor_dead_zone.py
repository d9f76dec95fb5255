"""Drive ignores small speed commands.

v = 0 where |v_ref| < width, else v_ref
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def command(speed, tension, width):
    """Speed that the drive follows [m/s]."""
    return 0.0 if abs(speed) < width else speed


EFFECT = Effect(
    id="motor.dead_zone",
    summary="drive ignores small speed commands",
    signature="tension stays off its reference by up to width over kp; no motion below the threshold, limit cycles",
    source="physics.md 4.A; 0-2 mm/s [A]",
    at={"motor.command": command},
    parameters=(EffectParameter("width", "m/s", null=0.0, low=2e-4, high=4e-3, axis=TENDONS, default=1e-3),),
    family="dead zone",
    order=110,
)
