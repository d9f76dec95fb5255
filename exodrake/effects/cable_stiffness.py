"""Cable loops that give way further than stated: thinner, longer or worn cables, and pretension that went.

k_j = k / (1 + share)            pretension_j = (1 - share) pretension
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def stiff(stiffness, share):
    """Stiffness of a loop with both strands taut [N m/rad]."""
    return stiffness / (1.0 + share)


def tensioned(pretension, share):
    """Pretension, as the effort of one strand [N m]."""
    return (1.0 - share) * pretension


SOFT = Effect(
    id="cable.softening",
    summary="cables softer than stated",
    signature="position of the joint off in proportion to its effort; a lower resonance of link against motor",
    source="steel cables lose up to half of their stiffness with layers and wear; range assumed",
    at={"cable.stiff": stiff},
    parameters=(EffectParameter("share", "-", null=0.0, low=-0.6, high=5.0, axis=JOINTS, default=0.5),),
    family="elasticity",
)
LOOSE = Effect(
    id="cable.lost_pretension",
    summary="pretension that went",
    signature="half the stiffness beyond the effort at which one strand goes slack",
    source="creep of cables and their ends; range assumed",
    at={"cable.tensioned": tensioned},
    parameters=(EffectParameter("share", "-", null=0.0, low=0.1, high=1.0, axis=JOINTS, default=0.5),),
    family="elasticity",
)
