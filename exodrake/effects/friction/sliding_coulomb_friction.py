"""Dry friction: a force against motion, and no more than would stop it.

v after the tick = v - sgn(v) min(|v|, force dt / M)
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.physics.dry_friction import slowed


def braked(speed, mobility, load, force):
    """Speed [m/s] after dry friction acted for a tick; mobility: dt / M [s/kg]."""
    return slowed(speed, force * mobility)


EFFECT = Effect(
    id="sliding.coulomb_friction",
    summary="dry friction",
    signature="force that the drive needs jumps at each reversal by twice the friction, whatever the speed",
    source="Coulomb's law; Janot, Gautier, Brunot 2019 (EMPS): 20.39 N; range assumed",
    at={"sliding.braked": braked},
    parameters=(EffectParameter("force", "force", null=0.0, low=0.13, high=4.0, default=1.0),),
    family="friction",
    order=120,
)
