"""Rate-independent loss in the joints: a bristle that turns round over a width of angle.

tau_p = elastic + torque z + end stops          dz/dq = (1 - z sgn(q')) / width
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import JOINTS
from exodrake.effects.friction.bristle import bent


def passive(passive_torque, bend, rate, elastic, clock, torque, width, bristle, bend_before):
    """Passive torque [N m]."""
    return passive_torque + torque * bent(bristle, bend - bend_before, width)


def relax(dt, bend, rate, elastic, torque, width, bristle, bend_before):
    """Bristle [-1 .. 1] and the bend it has seen [rad]."""
    return bent(bristle, bend - bend_before, width), bend


EFFECT = Effect(
    id="finger.hysteresis",
    summary="rate-independent loss in the joints",
    signature="loop of angle against tension and against stroke, rate-free, width independent of load",
    source="physics.md 4.D and 5 [A]",
    at={"finger.passive": passive, "finger.relax": relax},
    parameters=(
        EffectParameter("torque", "N m", null=0.0, low=3e-4, high=1e-2, axis=JOINTS, default=3e-3),
        EffectParameter("width", "rad", null=0.05, low=0.01, high=0.3, axis=JOINTS, default=0.05, transform="log"),
    ),
    states=(State("bristle", JOINTS), State("bend_before", JOINTS, unit="rad")),
    advances=("finger.relax",),
    family="hysteresis",
    order=435,
)
