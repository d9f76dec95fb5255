"""SO-101, an arm of six geared position servos (robot.yaml)."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from exodrake.core.machine import Machine
from exodrake.core.signal import JOINTS
from exodrake.effects import joint_gain, joint_lag, joint_play, joint_sag, timing_command_latency
from exodrake.effects.seated import seated
from exodrake.machines.position_servos import joint_machine

JOINT_NAMES = ("Rotation", "Pitch", "Elbow", "WristPitch", "WristRoll", "Jaw")
FRAMES = replace(timing_command_latency.EFFECT.numbers[0], over=JOINTS)
SHELF = (
    seated(timing_command_latency.EFFECT, "servo.latency", {"bus.sent": "joint_command.sent"}, frames=FRAMES),
    seated(joint_gain.EFFECT, "servo.gain"),
    seated(joint_sag.EFFECT, "servo.gravity_sag"),
    seated(joint_play.EFFECT, "servo.dead_band"),
    seated(joint_lag.EFFECT, "servo.lag"),
)


@cache
def so101() -> Machine:
    """Servos that stand at once where they are told."""
    return joint_machine("so101", "servo", JOINT_NAMES, SHELF, frame=0.02, depth=5)
