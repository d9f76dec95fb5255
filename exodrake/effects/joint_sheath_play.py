"""Play of a cable in a sheath: a sum of stop operators whose width grows with the bend of the sheath.

Friction holds the cable until it has stretched and lets go of it strand by strand; the joint follows the mean of the
strands (Prandtl-Ishlinskii).

    angle = aim - mean_k(w_k z_k)               w_k = half_width (1 - spread, 1, 1 + spread)
    z_k: stop operator of range w_k, -1 .. 1    half_width = width exp(mu bend)

Capstan: the tension that friction can hold grows by exp(mu bend). With no spread this is play.
"""

from math import exp

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import JOINTS
from exodrake.effects.friction.bristle import clipped

STRANDS = 3.0


def half_width(bend, width, mu):
    """Half the play [rad] of a sheath with this total bend [rad]."""
    return width * exp(mu * bend)


def let_go(stop, moved, width):
    """A stop [-1 .. 1] after the drive moved on [rad]; 0 for no width."""
    return clipped(stop, moved, width) if width > 0.0 else 0.0


def settle(dt, moved, ahead, behind, bend, width, mu, spread, first, second, third):
    """The stops [-1 .. 1] of the three strands."""
    middle = half_width(bend, width, mu)
    return (
        let_go(first, moved, middle * (1.0 - spread)),
        let_go(second, moved, middle),
        let_go(third, moved, middle * (1.0 + spread)),
    )


def followed(aim, before, dt, bend, width, mu, spread, first, second, third):
    """Angle after a tick [rad]."""
    return aim - half_width(bend, width, mu) * (first + second + third + spread * (third - first)) / STRANDS


EFFECT = Effect(
    id="joint.sheath_play",
    summary="play of a cable in a sheath, which grows with the bend as friction round a capstan does",
    signature="as play with rounded corners; over configurations the width grows exponentially with the total bend",
    source="physics.md 4.B capstan, Prandtl-Ishlinskii; Nho et al., RA-L 2021",
    at={"joint.followed": followed, "joint.settle": settle},
    parameters=(
        EffectParameter("width", "rad", null=0.0, low=0.02, high=1.0, axis=JOINTS, default=0.3),
        EffectParameter("mu", "1/rad", null=0.0, low=0.0, high=0.5, axis=JOINTS, default=0.1),
        EffectParameter("spread", "-", null=0.0, low=0.0, high=0.8, axis=JOINTS, default=0.2),
    ),
    states=(State("stops", JOINTS, 3),),
    advances=("joint.settle",),
    family="backlash",
)
