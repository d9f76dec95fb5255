"""What a sensor does to its signal: the laws, then the errors of any signal, of encoders and of motion capture.

A law takes the value and its parameters, and of its point's other arguments those that it names, so that it may act at
any point. `signal.*` are generic: each part made by `physics.reading.sensor` gets them. A law with memory returns the
value and then its states, or has them advanced at a point of its own.
"""

from math import exp, inf, sin

from exodrake.effects.friction import bend_bristle
from exodrake.model.effect import ANY_SHAPE, Effect, EffectParameter, per_joint, per_tendon
from exodrake.model.part import State
from exodrake.physics.arithmetic import round_to

DEPTH = 8  # samples that a late signal remembers


def scale(value, gain):
    """Value times a factor near 1: shown = (1 + gain) value."""
    return (1.0 + gain) * value


def shift(value, offset):
    """Value plus a constant: shown = value + offset."""
    return value + offset


def drift(value, clock, rate):
    """Value plus an amount that grows with time: shown = value + rate t; t from the first sample."""
    return value + rate * clock


def mix(value, other, coefficient):
    """Value plus a share of another one: shown_j = value_j + coefficient value_(j+1); the last one meets the first."""
    return value + coefficient * other


def cut_dead_zone(value, width):
    """Value by how much it lies beyond a width: shown = value - min(max(value, -width), width)."""
    return value - min(max(value, -width), width)


def clip(value, limit):
    """Value clipped at both ends: shown = min(max(value, -limit), limit)."""
    return min(max(value, -limit), limit)


def take_up_play(value, before, half_width):
    """Value behind play: shown <- min(max(shown, value - half_width), value + half_width)."""
    return min(max(before, value - half_width), value + half_width)


def lose_sample(value, held, arrival, probability):
    """Value of which samples are lost: shown(n) = shown(n - 1) where arrival < probability; arrival in 0 .. 1."""
    return held if arrival < probability else value


def relax(state, target, dt, time_constant):
    """First-order relaxation: state after dt [s] on its way to a target held meanwhile, exact."""
    return target + (state - target) * exp(-dt / time_constant)


def hysteresis(value, clock, error, width, bristle, before):
    """Value that remembers the way it has come, then the bristle [-1 .. 1] and the value that it has seen.

    shown = value + error z          dz/dvalue = (1 - z sgn(value')) / width
    """
    after = bend_bristle(bristle, value - before, width) if clock > 0.0 else 0.0
    return value + error * after, after, value


def backlash(value, clock, half_width, held):
    """Value behind play, then its state: shown <- min(max(shown, value - half_width), value + half_width)."""
    after = take_up_play(value, held, half_width) if clock > 0.0 else value
    return after, after


def low_pass(value, clock, period, time_constant, filtered):
    """Value behind a first-order filter, exact for one held over a sample, then the filter's state.

    time_constant shown' = value - shown
    """
    after = relax(filtered, value, period, time_constant) if clock > 0.0 else value
    return after, after


def delay_frames(value, clock, frames, h0, h1, h2, h3, h4, h5, h6, h7):
    """Value of some frames ago, then the samples remembered, the newest first: shown(n) = value(n - frames).

    Between samples the two neighbours are mixed. At most `DEPTH`; for a clock that is ahead (< 0) the line through the
    last two. Before the first sample the value was always the same.
    """
    if clock == 0.0:
        h0 = h1 = h2 = h3 = h4 = h5 = h6 = h7 = value
    values = value, h0, h1, h2, h3, h4, h5, h6, h7
    if frames <= 0.0:
        shown = value - frames * (value - h0)
    else:
        whole = min(int(frames), DEPTH - 1)
        part = min(frames - whole, 1.0)
        shown = (1.0 - part) * values[whole] + part * values[whole + 1]
    return shown, value, h0, h1, h2, h3, h4, h5, h6


def delay(value, clock, period, lateness, h0, h1, h2, h3, h4, h5, h6, h7):
    """Value that comes late, by whole samples or by a fraction of one, then the samples remembered.

    shown(n) = value(n - delay / period)          between samples the two neighbours are mixed
    """
    frames = lateness / period if period > 0.0 else 0.0
    return delay_frames(value, clock, frames, h0, h1, h2, h3, h4, h5, h6, h7)


def skew_clock(value, clock, period, skew, h0, h1, h2, h3, h4, h5, h6, h7):
    """Value by a clock that runs fast (> 0) or slow, then the samples remembered: shown(t) = value(t - skew t)."""
    frames = skew * clock / period if period > 0.0 else 0.0
    return delay_frames(value, clock, frames, h0, h1, h2, h3, h4, h5, h6, h7)


def slip_skin(angle, slip):
    """Angle as the markers show it [rad], as skin slides over the bone: q as seen = q + slip sin(2 q)."""
    return angle + slip * sin(2.0 * angle)


HOMING = """\
stroke as read = s - offset

The zero lies `offset` further in than where the wire is just taut at q = 0: a robot that starts where its encoder says
that the wire is just taut starts `offset` further in."""
ENCODER_OFFSET = Effect(
    id="encoder.homing_offset", summary="stroke zero in the wrong place", family="offset",
    signature="constant stroke offset at every tension; a negative one is the same as a slack wire",
    source="physics.md 4.A; 0-2 mm; from 3 mm on two wires would start beyond their maximum tension of 8 N",
    at={"motor.wound": shift}, formula=HOMING,
    parameters=(per_tendon("offset", "m", null=0.0, low=-5e-3, high=2.5e-3, default=1e-3),), same_meaning=True,
)  # fmt: skip
MOCAP_GAIN = Effect(
    id="mocap.gain", summary="skin-marker artefact: angles scaled", family="gain",
    signature="angle error proportional to angle; tension and stroke untouched",
    source="physics.md 4.G; slopes 0.98 PIP, 0.892 DIP against CT [S:Metcalf]", at={"mocap.seen": scale},
    formula="q as seen = (1 + gain) q",
    parameters=(per_joint("gain", "-", null=0.0, low=-0.25, high=0.25, default=-0.1),), same_meaning=True,
)  # fmt: skip
MOCAP_SKIN = Effect(
    id="mocap.skin_artefact", summary="skin slides over the bone most at half flexion", family="nonlinearity",
    signature="angle error curved over angle, greatest near 45 degrees; tension and stroke untouched",
    source="physics.md 4.G; below 4 deg [S:Metcalf]", at={"mocap.seen": slip_skin},
    parameters=(per_joint("slip", "rad", null=0.0, low=-0.1, high=0.1, default=0.03),), law_std=ANY_SHAPE,
    not_tried="another law of mocap.gain, which is tried",
)  # fmt: skip
MOCAP_OFFSET = Effect(
    id="mocap.offset", summary="marker frames misaligned", family="offset",
    signature="constant angle error; tension and stroke untouched", source="physics.md 4.G; 1-5 deg",
    at={"mocap.seen": shift}, formula="q as seen = q + offset",
    parameters=(per_joint("offset", "rad", null=0.0, low=-0.2, high=0.2, default=0.05),), same_meaning=True,
)  # fmt: skip
CROSSTALK = Effect(
    id="signal.crosstalk", summary="a sensor picks up its neighbour's value", family="crosstalk",
    signature="reading error proportional to another channel",
    source="cables, shared supplies, structures; 0.1-10 %; range assumed", at={"signal.mixed": mix},
    parameters=(EffectParameter("coefficient", "-", null=0.0, low=-0.3, high=0.3, default=0.05),), same_meaning=True,
)  # fmt: skip
HYSTERESIS = Effect(
    id="signal.hysteresis", summary="the sensor remembers the way its value has come", family="hysteresis",
    signature="reading differs between rising and falling values by an amount independent of rate",
    source="load cells and magnetic sensors, 0.05-1 % of full scale; range assumed", at={"signal.shown": hysteresis},
    parameters=(EffectParameter("error", "value", null=0.0, low=-0.1, high=0.1, default=0.03),
                EffectParameter("width", "value", null=0.05, low=0.01, high=0.3, default=0.05, transform="log")),
    states=(State("bristle"), State("before", unit="value")), filters=("signal.shown",),
)  # fmt: skip
BACKLASH = Effect(
    id="signal.backlash", summary="play before the sensor", family="backlash",
    signature="loop of constant width, rate-free, with flat pieces after each reversal",
    source="couplings and gears before a sensor; range assumed", at={"signal.shown": backlash},
    parameters=(EffectParameter("half_width", "value", null=0.0, low=0.005, high=0.3, default=0.05),),
    states=(State("held", unit="value"),), filters=("signal.shown",),
)  # fmt: skip
GAIN = Effect(
    id="signal.gain", summary="scale error of the reading", family="gain",
    signature="reading off in proportion to its value, without a loop",
    source="calibration of a sensor, 1-20 %; range assumed", at={"signal.shown": scale},
    parameters=(EffectParameter("gain", "-", null=0.0, low=-0.3, high=0.3, default=-0.1),), same_meaning=True,
)  # fmt: skip
OFFSET = Effect(
    id="signal.offset", summary="zero error of the reading", family="offset",
    signature="reading off by the same amount at every value",
    source="homing, marker frames, amplifiers; range assumed", at={"signal.shown": shift},
    parameters=(EffectParameter("offset", "value", null=0.0, low=-0.3, high=0.3, default=0.05),), same_meaning=True,
)  # fmt: skip
DRIFT = Effect(
    id="signal.drift", summary="zero of the reading wanders with time", family="drift",
    signature="reading error that grows with time, not with value or rate",
    source="temperature of sensors and amplifiers, which takes minutes; range assumed", at={"signal.shown": drift},
    parameters=(EffectParameter("rate", "value/s", null=0.0, low=-5e-3, high=5e-3, default=2e-3),), law_std=ANY_SHAPE,
)  # fmt: skip
DEAD_ZONE = Effect(
    id="signal.dead_zone", summary="reading starts only from a width on", family="dead zone",
    signature="reading 0 near 0, and short by the width beyond",
    source="threshold in a driver, a loose coupling centred by a spring; range assumed",
    at={"signal.shown": cut_dead_zone},
    parameters=(EffectParameter("width", "value", null=0.0, low=0.005, high=0.3, default=0.05),),
)  # fmt: skip
SATURATION = Effect(
    id="signal.saturation", summary="reading clips at both ends", family="saturation",
    signature="reading levels off at one value, alike in both directions",
    source="range of a sensor or converter; range assumed", at={"signal.shown": clip},
    parameters=(EffectParameter("limit", "value", null=inf, low=0.05, high=0.35, default=0.2, transform="reciprocal"),),
)  # fmt: skip
LOW_PASS = Effect(
    id="signal.low_pass", summary="first-order filter in the reading", family="lag",
    signature="reading lags, and is smaller in fast motion; nothing at rest",
    source="amplifiers and smoothing in drivers; range assumed", at={"signal.shown": low_pass},
    parameters=(EffectParameter("time_constant", "period", null=0.0, low=0.3, high=30.0, default=3.0),),
    states=(State("filtered", unit="value"),), filters=("signal.shown",),
)  # fmt: skip
DELAY = Effect(
    id="signal.delay", summary="reading comes late, by a fraction of a sample or more", family="delay",
    signature="reading error proportional to rate: phase without loss of magnitude; nothing at rest",
    source="transport and bus; range assumed", at={"signal.shown": delay},
    parameters=(EffectParameter("delay", "period", null=0.0, low=0.05, high=6.0, default=0.8),),
    states=(State("history", width=DEPTH, unit="value"),), filters=("signal.shown",), same_meaning=True,
)  # fmt: skip
CLOCK_SKEW = Effect(
    id="signal.clock_skew", summary="the sensor's clock runs fast or slow", family="delay",
    signature="reading error proportional to rate and growing along the log",
    source="1-100 ppm for crystals, some more for a software clock; range assumed", at={"signal.shown": skew_clock},
    parameters=(EffectParameter("skew", "s/s", null=0.0, low=-1e-3, high=1e-3, default=5e-4),),
    states=(State("history", width=DEPTH, unit="value"),), filters=("signal.shown",), same_meaning=True,
)  # fmt: skip
QUANTISATION = Effect(
    id="signal.quantisation", summary="reading in coarser steps than stated", family="quantisation",
    signature="readings are multiples of one step; error uniform within half of it",
    source="resolution of encoders and converters; range assumed", at={"signal.delivered": round_to},
    formula="shown = step round(value / step)",
    parameters=(EffectParameter("step", "value", null=0.0, low=0.005, high=0.1, default=0.02),),
    not_tried="rounding is noise to a fit; the values of the readings show it, and the resolution is a parameter",
)  # fmt: skip
PACKET_LOSS = Effect(
    id="signal.packet_loss", summary="some readings are lost", family="packet loss",
    signature="readings repeat themselves while the signal moves; on average a small delay",
    source="wireless and shared buses, 1e-3-0.1; range assumed", at={"signal.delivered": lose_sample},
    parameters=(EffectParameter("probability", "-", null=0.0, low=0.005, high=0.6, default=0.1),),
    not_tried="which readings are lost is drawn anew, so a fit sees the mean delay only; signal.delay is tried",
)  # fmt: skip
