"""Play between a motor's cables and its joint: keys, gears before the capstan, ends that sit loose.

d = sgn(d) max(0, |d| - half_width)
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def taken(stretch, half_width):
    """Stretch of the cables [rad] once the play is taken up."""
    return max(0.0, stretch - half_width) + min(0.0, stretch + half_width)


EFFECT = Effect(
    id="cable.backlash",
    summary="play between the cables and the joint",
    signature="position of the joint against that of its motor is a loop of constant width",
    source="physics.md 4.A gear backlash 0.2-4 deg; range assumed",
    at={"cable.taken": taken},
    parameters=(EffectParameter("half_width", "rad", null=0.0, low=0.002, high=0.2, axis=JOINTS, default=0.02),),
    family="backlash",
)
