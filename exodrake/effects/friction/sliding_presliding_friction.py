"""Dry friction that builds up over the first bit of travel after a reversal: the contact yields before it slides.

F_net = F - force slide          slide: -1 .. 1, grows with travel / presliding
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.effects.friction.bristle import clipped


def pushed(force_drive, speed, force, presliding, slide):
    """Force on the part [N]."""
    return force_drive - force * slide


def settle(dt, travel, force, presliding, slide):
    """How far the contact has yielded, -1 .. 1, sliding at both ends."""
    return clipped(slide, travel, presliding)


EFFECT = Effect(
    id="sliding.presliding_friction",
    summary="dry friction that builds up over the first travel after a reversal",
    signature="as dry friction, but the force that the drive needs turns over a fixed travel and not at once",
    source="Armstrong-Helouvry et al., Automatica 30(7), 1994 (presliding displacement); range assumed",
    at={"sliding.pushed": pushed, "sliding.settle": settle},
    parameters=(
        EffectParameter("force", "force", null=0.0, low=0.13, high=4.0, default=1.0),
        EffectParameter("presliding", "length", null=1e-3, low=2e-4, high=1e-2, default=1e-3, transform="log"),
    ),
    states=(State("slide"),),
    advances=("sliding.settle",),
    family="friction",
    order=130,
)
