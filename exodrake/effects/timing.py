"""Timing: commands that come late or not at all, and motion capture by a clock of its own."""

from exodrake.effects.signal import drift, lose_sample, shift
from exodrake.model.effect import Effect, EffectParameter


def delay_command(command, history, first, depth, passed, step, frames):
    """Command that arrives late by a number of frames.

    c(n) = c_cmd(n - frames)          within a step the two neighbours are mixed, so that a fit can move through
    """
    frames = min(max(frames, 0.0), depth - 2.0)
    whole = int(frames)
    older = min(max((frames - whole - passed) / step, 0.0), 1.0)
    return (1.0 - older) * history[first + whole] + older * history[first + whole + 1]


def jitter_command(command, history, first, frame_arrival, spread):
    """Speed that reaches the drive [m/s] late by a random part of a frame, for a drive that ramps between commands.

        v = (1 - spread u) v_cmd(n) + spread u v_cmd(n - 1)          u: uniform in 0 .. 1, one per frame

    One draw for all drives: what delays a frame is the computer or the bus that they share.
    """
    late = spread * frame_arrival
    return (1.0 - late) * command + late * history[first + 1]


COMMAND_LATENCY = Effect(
    id="timing.command_latency", summary="commands arrive late by a number of frames", family="delay",
    signature="the motion follows the command late by a fixed time: phase without loss of magnitude; a loop overshoots",
    source="physics.md 4.E; 0-20 ms and more on a shared bus", at={"bus.sent": delay_command},
    parameters=(EffectParameter("frames", "-", null=0.0, low=0.25, high=6.0, default=2.0),), same_meaning=True,
)  # fmt: skip
JITTER = Effect(
    id="timing.jitter", summary="commands reach the drive late by a random part of a frame", family="delay",
    signature="stroke error of random sign proportional to the change of the command; a small delay on average",
    source="physics.md 4.E; 0-2 ms on a bus, a frame on a busy computer", at={"bus.sent": jitter_command},
    parameters=(EffectParameter("spread", "-", null=0.0, low=0.05, high=1.0, default=0.5),),
    not_tried="on average a delay of the command; timing.command_latency is tried",
)  # fmt: skip
DROPPED_COMMANDS = Effect(
    id="timing.dropped_commands", summary="some command frames are lost", family="packet loss",
    signature="stroke goes on at the old speed for a frame or more at random instants; on average a small delay",
    source="physics.md 4.E; 1e-4-1e-2, worse on a faulty bus", at={"bus.sent": lose_sample},
    formula="v(n) = v(n - 1) where packet_arrival < probability, else v_cmd(n)",
    parameters=(EffectParameter("probability", "-", null=0.0, low=0.005, high=0.6, default=0.15),), same_meaning=True,
    detector="packet_loss",
)  # fmt: skip
MOCAP_DELAY = Effect(
    id="timing.mocap_delay", summary="motion capture lags the controller's clock", family="delay",
    signature="angle error proportional to joint rate; tension and stroke untouched", source="physics.md 4.E; 0-20 ms",
    at={"mocap.late": shift}, formula="angle(t) as logged = angle at t - delay",
    parameters=(EffectParameter("delay", "s", null=0.0, low=-0.05, high=0.1, default=0.02),), same_meaning=True,
)  # fmt: skip
MOCAP_CLOCK_SKEW = Effect(
    id="timing.mocap_clock_skew", summary="motion capture's clock runs fast or slow", family="delay",
    signature="angle error proportional to joint rate and growing along the log; tension and stroke untouched",
    source="physics.md 4.E; 1-100 ppm for crystals, far more for a software clock", at={"mocap.late": drift},
    formula="angle(t) as logged = angle at t - skew t          skew > 0: the clock runs fast",
    parameters=(EffectParameter("skew", "s/s", null=0.0, low=-5e-3, high=5e-3, default=1e-3),), same_meaning=True,
)  # fmt: skip
