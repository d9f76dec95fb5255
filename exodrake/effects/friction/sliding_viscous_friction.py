"""Friction proportional to speed.

F_net = F - coefficient v
"""

from exodrake.core.effect import Effect, EffectParameter


def pushed(force, speed, coefficient):
    """Force on the part [N]."""
    return force - coefficient * speed


EFFECT = Effect(
    id="sliding.viscous_friction",
    summary="friction proportional to speed",
    signature="force that the drive needs grows with speed, the same in both directions",
    source="Newton's law of a lubricated gap; Janot, Gautier, Brunot 2019 (EMPS): 203.5 N s/m for 95 kg",
    at={"sliding.pushed": pushed},
    parameters=(EffectParameter("coefficient", "force/speed", null=0.0, low=0.13, high=4.0, default=1.0),),
    family="friction",
    order=105,
)
