"""Viscous friction that differs from one direction to the other.

F_net = F - coefficient |v|          friction is c + coefficient forwards and c - coefficient backwards
"""

from exodrake.core.effect import Effect, EffectParameter


def pushed(force, speed, coefficient):
    """Force on the part [N]."""
    return force - coefficient * abs(speed)


EFFECT = Effect(
    id="sliding.direction",
    summary="viscous friction differs from one direction to the other",
    signature="the drive needs more force one way than the other, the more the faster",
    source="Janot, Gautier, Brunot 2019 (EMPS): asymmetric friction lowers the error from 4.08 to 3.11 %",
    at={"sliding.pushed": pushed},
    parameters=(EffectParameter("coefficient", "force/speed", null=0.0, low=-1.0, high=1.0, default=0.13),),
    family="friction",
    order=110,
)
