"""Gear losses proportional to load: the rotor feels more when it winds, less when it is driven back.

    felt = T_c + F          T_c (efficiency - 1) <= F <= T_c (1 / efficiency - 1)          F of `friction.jenkins`

While winding felt = T_c / efficiency, while unwinding felt = T_c efficiency.
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import TENDONS
from exodrake.effects.friction.jenkins import spring, yielded

PRESLIDING = 2e-4  # wire over which the losses turn round at `jenkins.LOAD` [m], two radians of the rotor; assumed


def load(tension, spool, efficiency, force, spool_before):
    """Tension that the rotor feels [N], then the force of the losses [N] and the spool it has seen [m]."""
    low, high = tension * (efficiency - 1.0), tension * (1.0 / efficiency - 1.0)
    after = yielded(force, spool - spool_before, spring(1.0 / efficiency - 1.0, PRESLIDING), low, high)
    return tension + after, after, spool


EFFECT = Effect(
    id="motor.gear_efficiency",
    summary="gear losses proportional to load",
    signature="speed error against the command jumps with direction under load; the finger's loops untouched",
    source="physics.md 3.1, 4.A; 0.5-0.85 [S:FFAQ]",
    at={"motor.load": load},
    parameters=(EffectParameter("efficiency", "-", null=1.0, low=0.4, high=0.95, axis=TENDONS, default=0.65),),
    states=(State("force", TENDONS, unit="N"), State("spool_before", TENDONS, unit="m")),
    filters=("motor.load",),
    family="friction",
    not_tried="the drive's speed loop hides it until the current clips; motor.current_limit is tried",
    order=130,
)
