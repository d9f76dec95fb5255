"""Motion lost in a bent sheath: a compliant cable passes on less of the command, the more so the more it is bent.

aim = command exp(-loss bend)
"""

from math import exp

from exodrake.core.effect import Effect, Number
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
    numbers=(Number("loss", "1/rad", neutral=0.0, low=-0.2, high=0.2, over=JOINTS, usual=0.05),),
)
