"""Cable-driven wrist of a da Vinci instrument, quasi-static, a row a second (robot.yaml)."""

from __future__ import annotations

from functools import cache

from exodrake.core.machine import Machine
from exodrake.effects import joint_coupling, joint_drag, joint_offset, joint_play
from exodrake.effects.seated import seated
from exodrake.machines.position_servos import joint_machine

SHELF = (
    seated(joint_coupling.NEXT, "cable.coupling_to_next"),
    seated(joint_coupling.PREVIOUS, "cable.coupling_to_previous"),
    seated(joint_offset.EFFECT, "cable.offset"),
    seated(joint_drag.NEXT, "cable.drag_by_next"),
    seated(joint_drag.PREVIOUS, "cable.drag_by_previous"),
    seated(joint_play.EFFECT, "cable.play"),
)


@cache
def dvrk_wrist() -> Machine:
    """Joints that stand where the kinematics of rigid cables put them."""
    return joint_machine("dvrk_wrist", "cable", ("q4", "q5", "q6"), SHELF, frame=1.0, depth=6)
