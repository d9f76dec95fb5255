"""Motion lost in a bent sheath: a compliant cable passes on less of the command, the more so the more it is bent.

aim = command exp(-loss bend)
"""

from math import exp

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def aimed(aim, ahead, behind, bend, loss):
    """Angle aimed at [rad]."""
    return aim * exp(-loss * bend)


EFFECT = Effect(
    id="joint.bend_loss",
    summary="a bent sheath passes on less of the command",
    signature="angle scales with the command by a factor that falls with the total bend",
    source="physics.md 4.B distributed elastic and friction; range assumed",
    at={"joint.aimed": aimed},
    parameters=(EffectParameter("loss", "1/rad", null=0.0, low=-0.2, high=0.2, axis=JOINTS, default=0.05),),
    family="gain",
)
