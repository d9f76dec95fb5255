"""Wire longer than assumed, which comes taut over a toe.

    x = s - l - length          stretch = max(0, x)                   |x| > toe / 2
                                        = (x + toe / 2)^2 / (2 toe)   within the toe

The strands of a braid straighten and its anchor settles before all of it pulls: the stretch sets in before `length` is
taken in, and half a toe beyond it is that of a straight line from there. A toe is no longer than the slack.
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def stretch(extension, tension_finger, length, toe):
    """Elastic stretch [m]; what is left of the slack below 0."""
    beyond, half = extension - length, 0.5 * min(toe, length)
    if beyond >= half:
        return beyond
    if beyond <= -half:
        return beyond + half
    return 0.25 * (beyond + half) * (beyond + half) / half


EFFECT = Effect(
    id="tendon.slack",
    summary="wire longer than assumed",
    signature="constant stroke offset at every tension; tension stays 0 while the first stroke is taken in",
    source="physics.md 4.B; 0.5-5 mm; toe of the braid and its anchor assumed",
    at={"tendon.stretch": stretch},
    parameters=(
        EffectParameter("length", "m", null=0.0, low=1e-4, high=5e-3, axis=TENDONS, default=1e-3),
        EffectParameter("toe", "m", null=1e-4, low=2e-5, high=1e-3, axis=TENDONS, default=1e-4, transform="log"),
    ),
    family="offset",
    same_meaning=True,
    order=205,
)
