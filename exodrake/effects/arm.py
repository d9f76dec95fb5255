"""Arm: masses, inertias, zeros and transmissions of its joints other than stated."""

from exodrake.core.effect import Effect, EffectParameter, per_joint
from exodrake.effects.signal import scaled, shifted

ENCODER_OFFSET = Effect(
    id="arm.encoder_offset", summary="zero of a joint's encoder in the wrong place", family="offset",
    signature="efforts of gravity off by a constant angle: a sine of the posture, on this joint and those before it",
    source="homing; range assumed", at={"arm.seen": shifted},
    formula="q_j = measured + offset          the arm stands elsewhere than measured",
    parameters=(per_joint("offset", "rad", null=0.0, low=-0.3, high=0.3, default=0.05),),
)  # fmt: skip
JOINT_COMPLIANCE = Effect(
    id="arm.joint_compliance", summary="elastic transmission between motor and joint", family="elasticity",
    signature="position at the motor off in proportion to the effort; a resonance of rotor against link",
    source="harmonic drives 1e4-1e5 N m/rad, cables and belts 3e2-1e4 N m/rad; range assumed",
    at={"arm.sprung": shifted},
    formula="theta - q = (c + compliance) tau          of cable, belt or harmonic drive; needs an inertia of the rotor",
    parameters=(per_joint("compliance", "rad/(N m)", null=0.0, low=3e-5, high=3e-3, default=5e-4),),
)  # fmt: skip
LINK_MASS = Effect(
    id="arm.link_mass", summary="mass of a link other than stated", family="inertia",
    signature="efforts of gravity and acceleration off on this joint and on those before it",
    source="CAD masses lack cables and covers, 5-50 %; range assumed", at={"arm.weighed": scaled},
    formula="m_j = (1 + share) m          its centre and its inertia about that stay",
    parameters=(per_joint("share", "-", null=0.0, low=-0.6, high=1.0, default=0.2),),
)  # fmt: skip
PAYLOAD = Effect(
    id="arm.payload", summary="a mass at the tip", family="inertia",
    signature="efforts of gravity and acceleration as of a mass at the tip, largest at the base's joints",
    source="Newton's law; range assumed: what arms of some 10 kg hold", at={"arm.carried": shifted},
    formula="m_tip = m + mass", parameters=(EffectParameter("mass", "kg", null=0.0, low=0.02, high=5.0, default=0.5),),
)  # fmt: skip
ROTOR_INERTIA = Effect(
    id="arm.rotor_inertia", summary="inertia of the rotor behind its gear", family="inertia",
    signature="effort off in proportion to the joint's own acceleration, whatever the posture",
    source="N^2 J: 0.01-3 kg m2 for gears of 50-160; range assumed", at={"arm.geared": shifted},
    formula="B_j = B + J N^2", parameters=(per_joint("inertia", "kg m2", null=0.0, low=0.01, high=3.0, default=0.1),),
)  # fmt: skip
