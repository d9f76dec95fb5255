"""Cable-driven arm and its geared motors: play, stiffness and pretension of cable loops, and their matrix A.

The motors feel the joints' efforts by the same matrix.
"""

from exodrake.core.effect import Effect, per_joint
from exodrake.effects.signal import beyond, mixed, scaled


def softer(stiffness, share):
    """Stiffness [N m/rad] of a loop of softer cables, both strands taut: k_j = k / (1 + share)."""
    return stiffness / (1.0 + share)


def looser(pretension, share):
    """Pretension that is left, as the effort of one strand [N m]: pretension_j = (1 - share) pretension."""
    return (1.0 - share) * pretension


ENTRY = "A_jk = a_jk + share a_jj          k: the motor before or after"
COUPLED = "a joint moves in proportion to another one's motor, without a loop, and its effort loads that motor"
COUPLING = "Hwang et al., RA-L 2020: coupled wrist cables; range assumed"
SHARE = per_joint("share", "-", null=0.0, low=-0.4, high=0.4, default=0.1)
BACKLASH = Effect(
    id="cable.backlash", summary="play between the cables and the joint", family="backlash",
    signature="position of the joint against that of its motor is a loop of constant width",
    source="physics.md 4.A gear backlash 0.2-4 deg; range assumed", at={"cable.taken": beyond},
    formula="d = sgn(d) max(0, |d| - half_width)          keys, gears before the capstan, ends that sit loose",
    parameters=(per_joint("half_width", "rad", null=0.0, low=0.002, high=0.2, default=0.02),),
)  # fmt: skip
COUPLING_TO_NEXT = Effect(
    id="cable.coupling_to_next", summary="cables run past the next joint's axis", family="crosstalk", same_meaning=True,
    signature=COUPLED, source=COUPLING, at={"cable.by_next": mixed}, parameters=(SHARE,), formula=ENTRY,
)  # fmt: skip
COUPLING_TO_PREVIOUS = Effect(
    id="cable.coupling_to_previous", summary="cables run past the previous joint's axis", family="crosstalk",
    signature=COUPLED, source=COUPLING, at={"cable.by_previous": mixed}, parameters=(SHARE,), formula=ENTRY,
    same_meaning=True,
)  # fmt: skip
LOST_PRETENSION = Effect(
    id="cable.lost_pretension", summary="pretension that went", family="elasticity",
    signature="half the stiffness beyond the effort at which one strand goes slack",
    source="creep of cables and their ends; range assumed", at={"cable.tensioned": looser},
    parameters=(per_joint("share", "-", null=0.0, low=0.1, high=1.0, default=0.5),),
)  # fmt: skip
RATIO_ERROR = Effect(
    id="cable.ratio_error", summary="the joint goes further or less far than its motor's angle says", family="gain",
    signature="position of the joint off in proportion to that of its motor, no loop",
    source="radii of capstans and cables; range assumed", at={"cable.ratio": scaled}, formula="A_jj = (1 + gain) a_jj",
    parameters=(per_joint("gain", "-", null=0.0, low=-0.3, high=0.3, default=0.05),), same_meaning=True,
)  # fmt: skip
SOFTENING = Effect(
    id="cable.softening", summary="cables softer than stated", family="elasticity",
    signature="position of the joint off in proportion to its effort; a lower resonance of link against motor",
    source="steel cables lose up to half of their stiffness with layers and wear; range assumed",
    at={"cable.stiff": softer}, parameters=(per_joint("share", "-", null=0.0, low=-0.6, high=5.0, default=0.5),),
)  # fmt: skip
TORQUE_GAIN = Effect(
    id="gear_motor.torque_gain", summary="torque constant or gear ratio other than stated", family="gain",
    signature="effort needed off in proportion to itself on one joint, at rest as in motion",
    source="magnets and their temperature, 5-20 %; range assumed", at={"gear_motor.driven": scaled},
    formula="tau_j = (1 + gain) k_t N i",
    parameters=(per_joint("gain", "-", null=0.0, low=-0.4, high=0.4, default=-0.1),),
)  # fmt: skip
