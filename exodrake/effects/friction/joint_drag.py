"""Friction between neighbours: the cables that pass a joint drag it along until they slip.

shown_j = angle_j + d          d <- min(max(d + share (change of the neighbour's aim), -reach), reach)
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import JOINTS


def shown(angle, share, reach, deflection):
    """Angle at the joint [rad]."""
    return angle + deflection


def slipped(deflection, moved, share, reach):
    """Deflection [rad] after the neighbour's aim moved."""
    return min(max(deflection + share * moved, -reach), reach)


def settle_by_next(dt, moved, ahead, behind, setting, share, reach, deflection):
    """Deflection [rad] by the next joint along the chain."""
    return slipped(deflection, ahead, share, reach)


def settle_by_previous(dt, moved, ahead, behind, setting, share, reach, deflection):
    """Deflection [rad] by the previous joint."""
    return slipped(deflection, behind, share, reach)


SUMMARY = "the cables of a neighbour drag a joint along until they slip"
SIGNATURE = "a joint that is commanded to rest goes to and fro between two stops as its neighbour turns round"
SOURCE = "friction of cables that pass a joint (Hwang et al., RA-L 2020); range assumed"
SHARE = EffectParameter("share", "-", null=0.0, low=-1.0, high=1.0, axis=JOINTS, default=0.4)
REACH = EffectParameter("reach", "rad", null=0.1, low=0.02, high=0.4, axis=JOINTS, default=0.1, transform="log")
BY_NEXT = {"joint.shown": shown, "joint.settle": settle_by_next}
BY_PREVIOUS = {"joint.shown": shown, "joint.settle": settle_by_previous}
PARAMETERS, STATES, AT = (SHARE, REACH), (State("deflection", JOINTS, unit="rad"),), ("joint.settle",)
NEXT = Effect("joint.drag_by_next", SUMMARY, SIGNATURE, SOURCE, BY_NEXT, PARAMETERS, STATES, AT, "friction")
PREVIOUS = Effect("joint.drag_by_previous", SUMMARY, SIGNATURE, SOURCE, BY_PREVIOUS, PARAMETERS, STATES, AT, "friction")
