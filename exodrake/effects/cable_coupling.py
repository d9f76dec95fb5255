"""Matrix A of a cable-driven arm other than its software believes: radii of capstans, cables past other joints' axes.

    A_jj = (1 + share) a_jj          A_jk = a_jk + share a_jj          k: the motor before or after

The motors feel the joints' efforts by the same matrix.
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def ratio(own, gain):
    """What a joint takes of its own motor's angle [-]."""
    return (1.0 + gain) * own


def coupled(other, own, share):
    """What a joint takes of another motor's angle [-]; own: of its own motor's."""
    return other + share * own


COUPLED = "a joint moves in proportion to another one's motor, without a loop, and its effort loads that motor"
SOURCE = "Hwang et al., RA-L 2020: coupled wrist cables; range assumed"
SHARE = EffectParameter("share", "-", null=0.0, low=-0.4, high=0.4, axis=JOINTS, default=0.1)
RATIO = Effect(
    id="cable.ratio_error",
    summary="the joint goes further or less far than its motor's angle says",
    signature="position of the joint off in proportion to that of its motor, no loop",
    source="radii of capstans and cables; range assumed",
    at={"cable.ratio": ratio},
    parameters=(EffectParameter("gain", "-", null=0.0, low=-0.3, high=0.3, axis=JOINTS, default=0.05),),
    family="gain",
    same_meaning=True,
)
PREVIOUS = Effect(
    "cable.coupling_to_previous", "cables run past the previous joint's axis", COUPLED, SOURCE,
    {"cable.by_previous": coupled}, (SHARE,), family="crosstalk", same_meaning=True,
)  # fmt: skip
NEXT = Effect(
    "cable.coupling_to_next", "cables run past the next joint's axis", COUPLED, SOURCE,
    {"cable.by_next": coupled}, (SHARE,), family="crosstalk", same_meaning=True,
)  # fmt: skip
