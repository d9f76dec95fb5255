"""Play: the joint stays where it is until the drive has taken up the slack, then follows at its edge.

angle <- min(max(angle, aim - half_width), aim + half_width)
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def followed(aim, before, dt, setting, half_width):
    """Angle after a tick [rad]."""
    return min(max(before, aim - half_width), aim + half_width)


EFFECT = Effect(
    id="joint.play",
    summary="play: the joint rests until the drive has taken up the slack",
    signature="angle against command is a loop of constant width, rate-free, with flat pieces after each reversal",
    source="physics.md 4.A gear backlash 0.2-4 deg; cables more (Hwang et al., RA-L 2020)",
    at={"joint.followed": followed},
    parameters=(EffectParameter("half_width", "rad", null=0.0, low=0.002, high=0.6, axis=JOINTS, default=0.05),),
    family="backlash",
)
