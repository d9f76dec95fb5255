"""Mass of a link other than stated; its centre and its inertia about that stay.

m_j = (1 + share) m
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import JOINTS


def weighed(mass, share):
    """Mass of the link [kg]."""
    return (1.0 + share) * mass


EFFECT = Effect(
    id="arm.link_mass",
    summary="mass of a link other than stated",
    signature="efforts of gravity and acceleration off on this joint and on those before it",
    source="CAD masses lack cables and covers, 5-50 %; range assumed",
    at={"arm.weighed": weighed},
    parameters=(EffectParameter("share", "-", null=0.0, low=-0.6, high=1.0, axis=JOINTS, default=0.2),),
    family="inertia",
)
