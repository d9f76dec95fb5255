"""A constant force on the carriage: a tilted guide, or the zero of the amplifier.

F_net = F - force
"""

from exodrake.core.effect import Effect, EffectParameter


def pushed(drive_force, speed, force):
    """Force on the mass [N]."""
    return drive_force - force


EFFECT = Effect(
    id="carriage.offset",
    summary="a constant force: tilt, or the zero of the amplifier",
    signature="the drive needs more force one way than the other, by the same amount at every speed",
    source="Janot, Gautier, Brunot 2019 (EMPS): -3.16 N",
    at={"carriage.pushed": pushed},
    parameters=(EffectParameter("force", "N", null=0.0, low=-15.0, high=15.0, default=3.0),),
    family="offset",
    order=115,
)
