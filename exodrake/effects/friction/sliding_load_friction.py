"""Dry friction proportional to the load that the drive puts on gear, screw or guide.

v after the tick = v - sgn(v) min(|v|, coefficient |F| dt / M)          F: force of the drive
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.physics.dry_friction import slowed


def braked(speed, mobility, load, coefficient):
    """Speed [m/s] after the friction acted for a tick; mobility: dt / M [s/kg]; load: |F| [N]."""
    return slowed(speed, coefficient * load * mobility)


EFFECT = Effect(
    id="sliding.load_friction",
    summary="dry friction proportional to the drive's force",
    signature="the drive needs more force in proportion to the force it gives, accelerating as braking",
    source="gear and screw efficiency 0.5-0.98; Duclusaud et al., ICRA 2025 (load-dependent friction of servos)",
    at={"sliding.braked": braked},
    parameters=(EffectParameter("coefficient", "-", null=0.0, low=0.02, high=0.6, default=0.15),),
    family="friction",
    order=122,
)
