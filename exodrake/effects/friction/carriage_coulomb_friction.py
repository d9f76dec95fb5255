"""Dry friction of the carriage: a force against motion, and no more than would stop it.

v after the tick = v - sgn(v) min(|v|, force dt / M)
"""

from exodrake.core.effect import Effect, EffectParameter


def braked(speed, mobility, force):
    """Speed [m/s] after dry friction acted for a tick; mobility: dt / M [s/kg]."""
    loss = force * mobility
    return speed - loss if speed > loss else speed + loss if speed < -loss else 0.0


EFFECT = Effect(
    id="carriage.coulomb_friction",
    summary="dry friction",
    signature="force that the drive needs jumps at each reversal by twice the friction, whatever the speed",
    source="Janot, Gautier, Brunot 2019 (EMPS): 20.39 N",
    at={"carriage.braked": braked},
    parameters=(EffectParameter("force", "N", null=0.0, low=2.0, high=60.0, default=15.0),),
    family="friction",
    order=120,
)
