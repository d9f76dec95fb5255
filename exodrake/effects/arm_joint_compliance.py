"""Elastic cable, belt or harmonic drive between the motor and its joint, which needs an inertia of the rotor.

theta - q = (c + compliance) tau
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def sprung(own, compliance):
    """Compliance between drive and joint [rad/(N m)]."""
    return own + compliance


EFFECT = Effect(
    id="arm.joint_compliance",
    summary="elastic transmission between motor and joint",
    signature="position at the motor off in proportion to the effort; a resonance of rotor against link",
    source="harmonic drives 1e4-1e5 N m/rad, cables and belts 3e2-1e4 N m/rad; range assumed",
    at={"arm.sprung": sprung},
    parameters=(EffectParameter("compliance", "rad/(N m)", null=0.0, low=3e-5, high=3e-3, axis=JOINTS, default=5e-4),),
    family="elasticity",
)
