"""A constant force on a sliding or turning part: tilt, a spring, or the zero of the amplifier.

F_net = F - force
"""

from exodrake.core.effect import Effect, EffectParameter


def pushed(drive_force, speed, force):
    """Force on the part [N]."""
    return drive_force - force


EFFECT = Effect(
    id="sliding.offset",
    summary="a constant force: tilt, or the zero of the amplifier",
    signature="the drive needs more force one way than the other, by the same amount at every speed",
    source="Janot, Gautier, Brunot 2019 (EMPS): -3.16 N of 200 N; range assumed",
    at={"sliding.pushed": pushed},
    parameters=(EffectParameter("force", "force", null=0.0, low=-1.0, high=1.0, default=0.2),),
    family="offset",
    same_meaning=True,
    order=115,
)
