"""The supply cannot drive the motor faster than a speed that falls with load; a load that pulls the wire out helps it.

-(limit + coefficient T_c) <= v <= max(0, limit - coefficient T_c)          v > 0 while the spool takes wire in
"""

from math import inf

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def command(speed, tension, limit, coefficient):
    """Speed that the drive follows [m/s]."""
    drop = coefficient * tension
    return min(max(speed, -limit - drop), max(limit - drop, 0.0))


EFFECT = Effect(
    id="motor.speed_droop",
    summary="supply limits the speed: the less of it is left to pull, the more to let out, the higher the load",
    signature="stroke rate levels off in large steps, under load at a lower level inwards; slow motion untouched",
    source="physics.md 4.A; 70-150 mm/s no-load, stall at 42 N gives 2-3 mm/s per N; above 50 mm/s it hardly shows",
    at={"motor.command": command},
    parameters=(
        EffectParameter(
            "limit", "m/s", null=inf, low=0.005, high=0.05, axis=TENDONS, default=0.03, transform="reciprocal"
        ),
        EffectParameter("coefficient", "m/(s N)", null=0.0, low=0.0, high=0.005, axis=TENDONS, default=0.002),
    ),
    family="saturation",
    not_tried="rare: a drive this far below its no-load speed hardly droops; motor.current_limit is tried",
    order=115,
)
