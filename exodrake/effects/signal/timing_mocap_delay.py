"""Motion capture lags the controller's clock.

angle(t) as logged = angle at t - delay
"""

from exodrake.core.effect import Effect, EffectParameter


def late(lateness, clock, delay):
    """How late the picture is [s]."""
    return lateness + delay


EFFECT = Effect(
    id="timing.mocap_delay",
    summary="motion capture lags the controller's clock",
    signature="angle error proportional to joint rate; tension and stroke untouched",
    source="physics.md 4.E; 0-20 ms",
    at={"mocap.late": late},
    parameters=(EffectParameter("delay", "s", null=0.0, low=-0.05, high=0.1, default=0.02),),
    family="delay",
    same_meaning=True,
    order=520,
)
