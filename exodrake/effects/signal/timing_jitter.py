"""Commands reach the drive late by a random part of a frame, as seen by a drive that ramps between them.

v = (1 - spread u) v_cmd(n) + spread u v_cmd(n - 1)          u: uniform in 0 .. 1, one per frame

One draw for all drives: what delays a frame is the computer or the bus that they share.
"""

from exodrake.core.effect import Effect, EffectParameter


def sent(command, history, first, applied, packet_arrival, frame_arrival, spread):
    """Speed that reaches the drive [m/s]."""
    late = spread * frame_arrival
    return (1.0 - late) * command + late * history[first + 1]


EFFECT = Effect(
    id="timing.jitter",
    summary="commands reach the drive late by a random part of a frame",
    signature="stroke error of random sign proportional to the change of the command; a small delay on average",
    source="physics.md 4.E; 0-2 ms on a bus, a frame on a busy computer",
    at={"bus.sent": sent},
    parameters=(EffectParameter("spread", "-", null=0.0, low=0.05, high=1.0, default=0.5),),
    family="delay",
    not_tried="on average a delay of the command; timing.command_latency is tried",
    order=510,
)
