"""SO-101, an arm of six geared position servos (robot.yaml)."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from exodrake.core.machine import Machine
from exodrake.core.signal import JOINTS
from exodrake.effects import joint_gain, joint_lag, joint_play, joint_sag, timing_command_latency
from exodrake.effects.for_machine import for_machine
from exodrake.machines.position_servos import joint_machine

JOINT_NAMES = ("Rotation", "Pitch", "Elbow", "WristPitch", "WristRoll", "Jaw")
FRAMES = replace(timing_command_latency.EFFECT.parameters[0], axis=JOINTS)
EFFECTS = (
    for_machine(timing_command_latency.EFFECT, "servo.latency", {"bus.sent": "joint_command.sent"}, frames=FRAMES),
    for_machine(joint_gain.EFFECT, "servo.gain"),
    for_machine(joint_sag.EFFECT, "servo.gravity_sag"),
    for_machine(joint_play.EFFECT, "servo.dead_band"),
    for_machine(joint_lag.EFFECT, "servo.lag"),
)


@cache
def so101() -> Machine:
    """Servos that stand at once where they are told."""
    return joint_machine("so101", "servo", JOINT_NAMES, EFFECTS, frame=0.02, depth=5)
