"""Joint tissue relaxes (standard linear solid).

tau_p = elastic + fraction (elastic - w) + end stops          time_constant w' = elastic - w
elastic = kappa (q - q0)
"""

from exodrake.core.effect import ANY_SHAPE, Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import JOINTS
from exodrake.effects.relaxation import relaxed


def passive(torque, bend, rate, elastic, clock, fraction, time_constant, relaxed_torque):
    """Passive torque [N m]."""
    return torque + fraction * (elastic - relaxed_torque)


def relax(dt, bend, rate, elastic, fraction, time_constant, relaxed_torque):
    """Elastic torque that has relaxed [N m]."""
    return relaxed(relaxed_torque, elastic, dt, time_constant)


EFFECT = Effect(
    id="finger.viscoelasticity",
    summary="joint tissue relaxes (standard linear solid)",
    signature="angle creeps on at held tension; loop of angle against tension that depends on rate and fades when slow",
    source="physics.md 4.D; 10-30 %, 0.5-10 s",
    at={"finger.passive": passive, "finger.relax": relax},
    parameters=(
        EffectParameter("fraction", "-", null=0.0, low=0.03, high=0.8, axis=JOINTS, default=0.3),
        EffectParameter("time_constant", "s", null=2.0, low=0.2, high=20.0, axis=JOINTS, default=2.0, transform="log"),
    ),
    states=(State("relaxed_torque", JOINTS, unit="N m"),),
    advances=("finger.relax",),
    family="viscoelasticity",
    law_std=ANY_SHAPE,
    order=430,
)
