"""Cable-driven wrist of a da Vinci instrument, quasi-static, a row a second (robot.yaml)."""

from __future__ import annotations

from functools import cache

from exodrake.core.machine import Machine
from exodrake.effects import joint_coupling, joint_drag, joint_offset, joint_play
from exodrake.effects.for_machine import for_machine
from exodrake.machines.position_servos import joint_machine

EFFECTS = (
    for_machine(joint_coupling.NEXT, "cable.coupling_to_next"),
    for_machine(joint_coupling.PREVIOUS, "cable.coupling_to_previous"),
    for_machine(joint_offset.EFFECT, "cable.offset"),
    for_machine(joint_drag.NEXT, "cable.drag_by_next"),
    for_machine(joint_drag.PREVIOUS, "cable.drag_by_previous"),
    for_machine(joint_play.EFFECT, "cable.play"),
)


@cache
def dvrk_wrist() -> Machine:
    """Joints that stand where the kinematics of rigid cables put them."""
    return joint_machine("dvrk_wrist", "cable", ("q4", "q5", "q6"), EFFECTS, frame=1.0, depth=6)
