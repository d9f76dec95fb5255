"""Commands reach the motor whole frames late.

v(n) = v_cmd(n - frames)          between whole frames the two neighbours are mixed, so that a fit can move through them
"""

from exodrake.core.effect import Effect, EffectParameter

REMEMBERED = 12  # commands that the bus remembers [-]


def sent(command, history, first, applied, packet_arrival, frame_arrival, frames):
    """Speed that reaches the drive [m/s]."""
    late = min(max(frames, 0.0), REMEMBERED - 2.0)
    whole = int(late)
    part = late - whole
    return (1.0 - part) * history[first + whole] + part * history[first + whole + 1]


EFFECT = Effect(
    id="timing.command_latency",
    summary="commands reach the motor whole frames late",
    signature="stroke follows the command late by a fixed time: phase without loss of magnitude; the loop overshoots",
    source="physics.md 4.E; 0-20 ms and more on a shared bus",
    at={"bus.sent": sent},
    parameters=(EffectParameter("frames", "-", null=0.0, low=0.25, high=6.0, default=2.0),),
    family="delay",
    same_meaning=True,
    order=505,
)
