"""SO-101, an arm of six geared position servos (robot.yaml)."""

from functools import cache

from exodrake.core.machine import Machine
from exodrake.effects import for_machine
from exodrake.machines.position_servos import FRAMES, joint_machine

JOINT_NAMES = ("Rotation", "Pitch", "Elbow", "WristPitch", "WristRoll", "Jaw")
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
