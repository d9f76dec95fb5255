"""Dry friction that builds up over the first bit of travel after a reversal: the contact yields before it slides.

F_net = F - force slide          slide: -1 .. 1, grows with travel / presliding
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.part import State
from exodrake.core.signal import SCALAR
from exodrake.effects.friction.bristle import clipped


def pushed(force_drive, speed, force, presliding, slide):
    """Force on the mass [N]."""
    return force_drive - force * slide


def settle(dt, travel, force, presliding, slide):
    """How far the contact has yielded, -1 .. 1, sliding at both ends."""
    return clipped(slide, travel, presliding)


EFFECT = Effect(
    id="carriage.presliding_friction",
    summary="dry friction that builds up over the first travel after a reversal",
    signature="as dry friction, but the force that the drive needs turns over a fixed travel and not at once",
    source="Armstrong-Helouvry et al., Automatica 30(7), 1994 (presliding displacement); range assumed",
    at={"carriage.pushed": pushed, "carriage.settle": settle},
    parameters=(
        EffectParameter("force", "N", null=0.0, low=2.0, high=60.0, default=15.0),
        EffectParameter("presliding", "m", null=1e-4, low=2e-5, high=1e-3, default=1e-4, transform="log"),
    ),
    states=(State("slide", SCALAR),),
    advances=("carriage.settle",),
    family="friction",
    order=130,
)
