"""Wire longer than assumed.

T_c = max(0, k (s - l - length))
"""

from exodrake.core.effect import Effect, EffectParameter
from exodrake.core.signal import TENDONS


def stretch(extension, tension_finger, length):
    """Elastic stretch [m]."""
    return extension - length


EFFECT = Effect(
    id="tendon.slack",
    summary="wire longer than assumed",
    signature="constant stroke offset at every tension; tension stays 0 while the first stroke is taken in",
    source="physics.md 4.B; 0.5-5 mm",
    at={"tendon.stretch": stretch},
    parameters=(EffectParameter("length", "m", null=0.0, low=1e-4, high=5e-3, axis=TENDONS, default=1e-3),),
    family="offset",
    same_meaning=True,
    order=205,
)
