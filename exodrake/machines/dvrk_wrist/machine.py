"""Cable-driven wrist of a da Vinci instrument, quasi-static, a row a second (robot.yaml)."""

from functools import cache

from exodrake.core.machine import Machine
from exodrake.effects import for_machine
from exodrake.machines.position_servos import joint_machine

EFFECTS = (
    for_machine("joint.coupling_to_next", "cable.coupling_to_next"),
    for_machine("joint.coupling_to_previous", "cable.coupling_to_previous"),
    for_machine("joint.offset", "cable.offset"),
    for_machine("joint.drag_by_next", "cable.drag_by_next"),
    for_machine("joint.drag_by_previous", "cable.drag_by_previous"),
    for_machine("joint.play", "cable.play"),
)


@cache
def machine() -> Machine:
    """Joints driven by rigid cables without friction."""
    return joint_machine("dvrk_wrist", "cable", ("q4", "q5", "q6"), EFFECTS, frame=1.0, max_effects=6)
