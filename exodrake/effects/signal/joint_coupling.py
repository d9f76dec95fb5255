"""Cables that run past another joint's axis: its motion moves this joint, too.

aim_j = command_j + share command_k          k: the next joint along the chain, or the previous one
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def aimed_by_next(aim, ahead, behind, setting, share):
    """Angle aimed at [rad]."""
    return aim + share * ahead


def aimed_by_previous(aim, ahead, behind, setting, share):
    """Angle aimed at [rad]."""
    return aim + share * behind


SUMMARY = "cables run past another joint's axis, whose motion moves this one"
SIGNATURE = "a joint that is commanded to rest moves in proportion to its neighbour's command, without a loop"
SOURCE = "Hwang et al., RA-L 2020: coupled wrist cables; range assumed"
SHARE = EffectParameter("share", "-", null=0.0, low=-0.4, high=0.4, axis=JOINTS, default=0.1)
BY_NEXT, BY_PREVIOUS = {"joint.aimed": aimed_by_next}, {"joint.aimed": aimed_by_previous}
NEXT = Effect(
    "joint.coupling_to_next", SUMMARY, SIGNATURE, SOURCE, BY_NEXT, (SHARE,), family="crosstalk", same_meaning=True
)
PREVIOUS = Effect(
    "joint.coupling_to_previous",
    SUMMARY,
    SIGNATURE,
    SOURCE,
    BY_PREVIOUS,
    (SHARE,),
    family="crosstalk",
    same_meaning=True,
)
