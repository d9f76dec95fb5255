"""Serial arms, cable-driven ones and geared motors: masses, inertias, zeros and transmissions other than stated.

The motors of a cable-driven arm feel the joints' efforts by the same matrix A as the joints their angles.
"""

from exodrake.effects.signal import DEPTH, cut_dead_zone, delay_frames, mix, scale, shift
from exodrake.model.effect import Effect, EffectParameter, per_joint
from exodrake.model.part import JOINTS, State


def soften_loop(stiffness, share):
    """Stiffness [N m/rad] of a loop of softer cables, both strands taut: k_j = k / (1 + share)."""
    return stiffness / (1.0 + share)


def loosen_loop(pretension, share):
    """Pretension that is left, as the effort of one strand [N m]: pretension_j = (1 - share) pretension."""
    return (1.0 - share) * pretension


ENCODER_OFFSET = Effect(
    id="arm.encoder_offset", summary="zero of a joint's encoder in the wrong place", family="offset",
    signature="efforts of gravity off by a constant angle: a sine of the posture, on this joint and those before it",
    source="homing; range assumed", at={"arm.seen": shift},
    formula="q_j = measured + offset          the arm stands elsewhere than measured",
    parameters=(per_joint("offset", "rad", null=0.0, low=-0.3, high=0.3, default=0.05),),
)  # fmt: skip
DELAY = Effect(
    id="arm.delay", summary="efforts are logged later than the motion, or earlier (< 0)", family="delay",
    signature="effort off in proportion to its rate; nothing at rest",
    source="filters of speeds, transport and bus: some rows of a log; range assumed", at={"arm.late": shift},
    formula="effort(t) as logged = effort at t - delay",
    parameters=(per_joint("delay", "period", null=0.0, low=-3.0, high=3.0, default=1.0),), same_meaning=True,
)  # fmt: skip
COMMAND_LATENCY = Effect(
    id="arm_drive.latency", summary="references reach the controller late", family="delay",
    signature="position and effort late by one time at every speed, and alike; nothing at rest",
    source="buses and trajectory interpolators, 1-10 frames; range assumed", at={"arm_drive.referred": delay_frames},
    parameters=(per_joint("frames", "-", null=0.0, low=0.1, high=7.0, default=1.0),), same_meaning=True,
    states=(State("history", JOINTS, DEPTH),), filters=("arm_drive.referred",),
)  # fmt: skip
POSITION_GAIN, VELOCITY_GAIN = (
    Effect(
        id=f"arm_drive.{name}_gain", summary=f"gain of the controller on {what} other than stated", family="gain",
        signature=f"effort that the drive asks for off in proportion to {what}, motion with it", source=source,
        at={f"arm_drive.{point}": scale}, formula=f"{symbol}_j = (1 + share) {symbol}", same_meaning=True,
        parameters=(per_joint("share", "-", null=0.0, low=-0.7, high=2.0, default=-0.3),),
    )
    for source in ("registers and their units; range assumed",)
    for name, what, point, symbol in (
        ("position", "the position error", "stiffened", "K"), ("velocity", "the error's rate", "damped", "D"),
    )
)  # fmt: skip
GRAVITY_COMPENSATION = Effect(
    id="arm_drive.gravity_compensation", summary="the controller gives another share of the arm's weight than stated",
    family="load", signature="joints sag by their weight over their stiffness, as far as posture says; encoders see it",
    source="controllers without a model of the arm, or with one of another load: share of -1; range assumed",
    at={"arm_drive.compensated": shift}, formula="tau_ref = PD + (feedforward + share) g(q)",
    parameters=(per_joint("share", "-", null=0.0, low=-1.0, high=0.5, default=-0.5),), same_meaning=True,
)  # fmt: skip
JOINT_COMPLIANCE = Effect(
    id="arm.joint_compliance", summary="elastic transmission between motor and joint", family="elasticity",
    signature="position at the motor off in proportion to the effort; a resonance of rotor against link",
    source="harmonic drives 1e4-1e5 N m/rad, cables and belts 3e2-1e4 N m/rad; range assumed",
    at={"arm.sprung": shift},
    formula="theta - q = (c + compliance) tau          of cable, belt or harmonic drive; needs an inertia of the rotor",
    parameters=(per_joint("compliance", "rad/(N m)", null=0.0, low=3e-5, high=3e-3, default=5e-4),),
)  # fmt: skip
LINK_MASS = Effect(
    id="arm.link_mass", summary="mass of a link other than stated", family="inertia",
    signature="efforts of gravity and acceleration off on this joint and on those before it",
    source="CAD masses lack cables and covers, 5-50 %; inertia alike as in domain randomisation; range: half of none",
    at={"arm.weighed": scale},
    formula="m_j = (1 + share) m          its centre stays, its inertia about that grows alike",
    parameters=(per_joint("share", "-", null=0.0, low=-0.45, high=1.0, default=0.2),),
)  # fmt: skip
PAYLOAD = Effect(
    id="arm.payload", summary="a mass at the tip", family="inertia",
    signature="efforts of gravity and acceleration as of a mass at the tip, largest at the base's joints",
    source="Newton's law; range assumed: what arms of some 10 kg hold", at={"arm.carried": shift},
    formula="m_tip = m + mass", parameters=(EffectParameter("mass", "kg", null=0.0, low=0.02, high=5.0, default=0.5),),
)  # fmt: skip
ROTOR_INERTIA = Effect(
    id="arm.rotor_inertia", summary="inertia of the rotor behind its gear", family="inertia",
    signature="effort off in proportion to the joint's own acceleration, whatever the posture",
    source="N^2 J: 0.01-3 kg m2 for gears of 50-160; range assumed", at={"arm.geared": shift},
    formula="B_j = B + J N^2", parameters=(per_joint("inertia", "kg m2", null=0.0, low=0.01, high=3.0, default=0.1),),
)  # fmt: skip
BACKLASH = Effect(
    id="cable.backlash", summary="play between the cables and the joint", family="backlash",
    signature="position of the joint against that of its motor is a loop of constant width",
    source="physics.md 4.A gear backlash 0.2-4 deg; range assumed", at={"cable.taken": cut_dead_zone},
    formula="d = sgn(d) max(0, |d| - half_width)          keys, gears before the capstan, ends that sit loose",
    parameters=(per_joint("half_width", "rad", null=0.0, low=0.002, high=0.2, default=0.02),),
)  # fmt: skip
COUPLING_TO_NEXT, COUPLING_TO_PREVIOUS = (
    Effect(
        id=f"cable.coupling_to_{side}", summary=f"cables run past the {side} joint's axis", family="crosstalk",
        signature="a joint moves in proportion to another one's motor, without a loop, and its effort loads that motor",
        source="Hwang et al., RA-L 2020: coupled wrist cables; range assumed", at={f"cable.by_{side}": mix},
        formula="A_jk = a_jk + share a_jj          k: the motor before or after",
        parameters=(per_joint("share", "-", null=0.0, low=-0.4, high=0.4, default=0.1),), same_meaning=True,
    )
    for side in ("next", "previous")
)  # fmt: skip
LOST_PRETENSION = Effect(
    id="cable.lost_pretension", summary="pretension that went", family="elasticity",
    signature="half the stiffness beyond the effort at which one strand goes slack",
    source="creep of cables and their ends; range assumed", at={"cable.tensioned": loosen_loop},
    parameters=(per_joint("share", "-", null=0.0, low=0.1, high=1.0, default=0.9),),
)  # fmt: skip
RATIO_ERROR = Effect(
    id="cable.ratio_error", summary="the joint goes further or less far than its motor's angle says", family="gain",
    signature="position of the joint off in proportion to that of its motor, no loop",
    source="radii of capstans and cables; range assumed", at={"cable.ratio": scale}, formula="A_jj = (1 + gain) a_jj",
    parameters=(per_joint("gain", "-", null=0.0, low=-0.3, high=0.3, default=0.05),), same_meaning=True,
)  # fmt: skip
SOFTENING = Effect(
    id="cable.softening", summary="cables softer than stated", family="elasticity",
    signature="position of the joint off in proportion to its effort; a lower resonance of link against motor",
    source="steel cables lose up to half of their stiffness with layers and wear; range assumed",
    at={"cable.stiff": soften_loop}, parameters=(per_joint("share", "-", null=0.0, low=-0.6, high=5.0, default=0.5),),
)  # fmt: skip
TORQUE_GAIN = Effect(
    id="gear_motor.torque_gain", summary="torque constant or gear ratio other than stated", family="gain",
    signature="effort needed off in proportion to itself on one joint, at rest as in motion",
    source="magnets and their temperature, 5-20 %; range assumed", at={"gear_motor.driven": scale},
    formula="tau_j = (1 + gain) k_t N i",
    parameters=(per_joint("gain", "-", null=0.0, low=-0.4, high=0.4, default=-0.1),),
)  # fmt: skip
