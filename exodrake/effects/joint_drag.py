"""Friction between neighbours: a joint is dragged along by its neighbour's motion as far as its own play lets it.

angle_j <- angle_j + share (change of the neighbour's aim), then its own play
"""

from exodrake.block import JOINTS, Effect, Number


def dragged_by_next(before, ahead, behind, share):
    """Angle before the tick [rad]."""
    return before + share * ahead


def dragged_by_previous(before, ahead, behind, share):
    """Angle before the tick [rad]."""
    return before + share * behind


SUMMARY = "a joint is dragged along by its neighbour, within its own play"
SIGNATURE = "a joint that was told to rest goes to and fro between two stops as its neighbour turns round"
SOURCE = "friction of the cables that pass a joint (Hwang et al., RA-L 2020); range assumed"
SHARE = Number("share", "-", neutral=0.0, low=-1.5, high=1.5, over=JOINTS, usual=0.4)
BY_NEXT, BY_PREVIOUS = {"joint.dragged": dragged_by_next}, {"joint.dragged": dragged_by_previous}
NEXT = Effect("joint.drag_by_next", SUMMARY, SIGNATURE, SOURCE, BY_NEXT, (SHARE,))
PREVIOUS = Effect("joint.drag_by_previous", SUMMARY, SIGNATURE, SOURCE, BY_PREVIOUS, (SHARE,))
