"""The drive follows late, as a first-order lag, exact over a tick.

time_constant angle' = aim - angle
"""

from math import exp

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def followed(aim, before, dt, setting, time_constant):
    """Angle after a tick [rad]."""
    return before + (aim - before) * (1.0 - exp(-dt / time_constant)) if time_constant > 0.0 else aim


EFFECT = Effect(
    id="joint.lag",
    summary="the drive follows as a first-order lag",
    signature="angle behind the command, and smaller in fast motion",
    source="position loops of geared servos, 20-200 ms; range assumed",
    at={"joint.followed": followed},
    parameters=(EffectParameter("time_constant", "s", null=0.0, low=0.01, high=0.3, axis=JOINTS, default=0.06),),
    family="lag",
)
