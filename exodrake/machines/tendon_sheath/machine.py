"""Bending joint of a flexible endoscope, pulled by an antagonistic tendon pair in a sheath."""

from __future__ import annotations

from functools import cache

from exodrake.core.machine import Machine
from exodrake.effects import joint_bend_loss, joint_gain, joint_lag, joint_offset, joint_play, joint_sheath_play
from exodrake.effects.for_machine import for_machine
from exodrake.machines.position_servos import joint_machine

EFFECTS = (
    for_machine(joint_bend_loss.EFFECT, "sheath.bend_loss"),
    for_machine(joint_gain.EFFECT, "sheath.gain"),
    for_machine(joint_offset.EFFECT, "sheath.offset"),
    for_machine(joint_play.EFFECT, "sheath.play"),
    for_machine(joint_sheath_play.EFFECT, "sheath.capstan_play"),
    for_machine(joint_lag.EFFECT, "sheath.lag"),
)


@cache
def tendon_sheath() -> Machine:
    """A rigid transmission: the joint goes where it is told, whatever the sheath's bend."""
    return joint_machine("tendon_sheath", "sheath", ("bending",), EFFECTS, frame=0.025, depth=4, bent=True)
