"""Readings that are lost; the log repeats the last one.

shown(n) = shown(n - 1) where arrival < probability          arrival: uniform in 0 .. 1, one per sample
"""

from exodrake.core.effect import Effect, EffectParameter


def delivered(value, held, arrival, probability):
    """Value as delivered."""
    return held if arrival < probability else value


EFFECT = Effect(
    id="signal.packet_loss",
    summary="some readings are lost",
    signature="readings repeat themselves while the signal moves; on average a small delay",
    source="wireless and shared buses, 1e-3-0.1; range assumed",
    at={"signal.delivered": delivered},
    parameters=(EffectParameter("probability", "-", null=0.0, low=0.005, high=0.6, default=0.1),),
    family="packet loss",
    not_tried="which readings are lost is drawn anew, so a fit sees the mean delay only; signal.delay is tried",
    order=790,
)
