"""Motion capture's clock runs fast (skew > 0) or slow.

angle(t) as logged = angle at t - skew t
"""

from exodrake.core.effect import Effect, EffectParameter


def late(lateness, clock, skew):
    """How late the picture is [s]; clock: time since the log's start [s]."""
    return lateness + skew * clock


EFFECT = Effect(
    id="timing.mocap_clock_skew",
    summary="motion capture's clock runs fast or slow",
    signature="angle error proportional to joint rate and growing along the log; tension and stroke untouched",
    source="physics.md 4.E; 1-100 ppm for crystals, far more for a software clock",
    at={"mocap.late": late},
    parameters=(EffectParameter("skew", "s/s", null=0.0, low=-5e-3, high=5e-3, default=1e-3),),
    family="delay",
    same_meaning=True,
    order=525,
)
