"""Some command frames are lost; the drive keeps the speed held so far.

v(n) = v(n - 1) where packet_arrival < probability, else v_cmd(n)
"""

from exodrake.core.effect import Effect, EffectParameter


def sent(command, history, first, applied, packet_arrival, frame_arrival, probability):
    """Speed that reaches the drive [m/s]."""
    return applied if packet_arrival < probability else command


EFFECT = Effect(
    id="timing.dropped_commands",
    summary="some command frames are lost",
    signature="stroke goes on at the old speed for a frame or more at random instants; on average a small delay",
    source="physics.md 4.E; 1e-4-1e-2, worse on a faulty bus",
    at={"bus.sent": sent},
    parameters=(EffectParameter("probability", "-", null=0.0, low=0.005, high=0.6, default=0.15),),
    family="packet loss",
    same_meaning=True,
    detector="packet_loss",
    order=515,
)
