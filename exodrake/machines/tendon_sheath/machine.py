"""Bending joint of a flexible endoscope, pulled by an antagonistic tendon pair in a sheath."""

from __future__ import annotations

from functools import cache

from exodrake.core.machine import Machine
from exodrake.effects import joint_bend_loss, joint_gain, joint_lag, joint_offset, joint_play, joint_sheath_play
from exodrake.effects.seated import seated
from exodrake.machines.position_servos import joint_machine

SHELF = (
    seated(joint_bend_loss.EFFECT, "sheath.bend_loss"),
    seated(joint_gain.EFFECT, "sheath.gain"),
    seated(joint_offset.EFFECT, "sheath.offset"),
    seated(joint_play.EFFECT, "sheath.play"),
    seated(joint_sheath_play.EFFECT, "sheath.capstan_play"),
    seated(joint_lag.EFFECT, "sheath.lag"),
)


@cache
def tendon_sheath() -> Machine:
    """A rigid transmission: the joint goes where it is told, whatever the sheath's bend."""
    return joint_machine("tendon_sheath", "sheath", ("bending",), SHELF, frame=0.025, depth=4, bent=True)
