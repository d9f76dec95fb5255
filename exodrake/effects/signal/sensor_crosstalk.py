"""A cell picks up the next wire's load.

F_j = T_j + coefficient T_(j+1)          the last wire is followed by the first
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def mixed(load, following, coefficient):
    """Load that the amplifier sees [N]."""
    return load + coefficient * following


EFFECT = Effect(
    id="sensor.crosstalk",
    summary="a cell picks up the next wire's load",
    signature="reading error proportional to the tension of another wire",
    source="physics.md 4.C; 0.1-2 %",
    at={"sensor.mixed": mixed},
    parameters=(EffectParameter("coefficient", "-", null=0.0, low=-0.15, high=0.15, axis=TENDONS, default=0.03),),
    family="crosstalk",
    same_meaning=True,
    order=310,
)
