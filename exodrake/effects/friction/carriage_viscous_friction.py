"""Friction proportional to the carriage's speed.

F_net = F - coefficient v
"""

from exodrake.core.effect import Effect, EffectParameter


def pushed(force, speed, coefficient):
    """Force on the mass [N]."""
    return force - coefficient * speed


EFFECT = Effect(
    id="carriage.viscous_friction",
    summary="friction proportional to speed",
    signature="force that the drive needs grows with speed, the same in both directions",
    source="Janot, Gautier, Brunot 2019 (EMPS): 203.5 N s/m for 95 kg",
    at={"carriage.pushed": pushed},
    parameters=(EffectParameter("coefficient", "N s/m", null=0.0, low=20.0, high=600.0, default=150.0),),
    family="friction",
    order=105,
)
