"""Bending joint of a flexible endoscope, pulled by an antagonistic tendon pair in a sheath."""

from functools import cache

from exodrake.core.machine import Machine
from exodrake.effects import for_machine
from exodrake.machines.position_servos import BEND, joint_machine

EFFECTS = (
    for_machine("joint.bend_loss", "sheath.bend_loss"),
    for_machine("joint.gain", "sheath.gain"),
    for_machine("joint.offset", "sheath.offset"),
    for_machine("joint.play", "sheath.play"),
    for_machine("joint.sheath_play", "sheath.capstan_play"),
    for_machine("joint.lag", "sheath.lag"),
)


@cache
def machine() -> Machine:
    """A rigid transmission: the joint angle is the commanded one at any bend of the sheath."""
    return joint_machine("tendon_sheath", "sheath", ("bending",), EFFECTS, frame=0.025, max_effects=4, settings=(BEND,))
