"""SO-101, an arm of six geared position servos (robot.yaml)."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from exodrake.core.machine import Machine
from exodrake.core.signal import JOINTS
from exodrake.effects import LIBRARY, for_machine
from exodrake.machines.position_servos import joint_machine

JOINT_NAMES = ("Rotation", "Pitch", "Elbow", "WristPitch", "WristRoll", "Jaw")
FRAMES = replace(LIBRARY["timing.command_latency"].parameters[0], axis=JOINTS)
EFFECTS = (
    for_machine("timing.command_latency", "servo.latency", {"bus.sent": "joint_command.sent"}, frames=FRAMES),
    for_machine("joint.gain", "servo.gain"),
    for_machine("joint.gravity_sag", "servo.gravity_sag"),
    for_machine("joint.play", "servo.dead_band"),
    for_machine("joint.lag", "servo.lag"),
)


@cache
def machine() -> Machine:
    """Ideal position servos without dynamics."""
    return joint_machine("so101", "servo", JOINT_NAMES, EFFECTS, frame=0.02, max_effects=5)
