"""Responses of a closed loop: steps of the nonlinear loop, and frequency response by multisine and the frame map."""

from dataclasses import dataclass, field, replace
from typing import Any

import control
import numpy as np

from exodrake.analysis.linear_model import FrameMap, FrameModel, OperatingPoint, evaluate
from exodrake.core.errors import short_repr
from exodrake.engine.inputs import prepare_values
from exodrake.model.display import percent

BEFORE, AFTER = 10, 300  # frames shown before the step and simulated after it
BAND = 0.02  # settling band, as a share of the step
PERIOD = 500  # frames
LINES = np.arange(1, (PERIOD + 1) // 2, 2)  # odd harmonics below the Nyquist frequency
DRAWS = 4
RMS = 0.05  # of the excitation, as a share of the loop's step
PHASES = 20  # seed of the phases
HALF_POWER = 0.5**0.5
BENT = 0.1  # RMS distance of a step from that of the linear model, as a share of it, that deserves a word; assumed
KICK, KICKED = 0.1, 1000  # reference step of one frame, as a share of the loop's step; frames simulated
HARD = 1.0  # the same for a loop that a small kick does not move


def first_crossing(x: np.ndarray, y: np.ndarray, level: float) -> float:
    """Abscissa at which y (n,) first reaches a level [unit of y] from below, linear between samples at x (n,), rising.

    x[0] if y begins at the level or above, NaN if it never reaches it.
    """
    above = np.flatnonzero(y >= level)
    if not len(above) or (k := int(above[0])) == 0:
        return float(x[0]) if len(above) else float("nan")
    return float(x[k - 1] + (x[k] - x[k - 1]) * (level - y[k - 1]) / (y[k] - y[k - 1]))


@short_repr
@dataclass(frozen=True, eq=False)
class StepResponse:
    """Response of the controlled quantity to a step of one channel's reference, without noise."""

    channel: str
    size: float  # [SI]
    time: np.ndarray = field(repr=False)  # (n,) one per slot [s]; the frame with the new reference starts at 0
    output: np.ndarray = field(repr=False)  # (n, channels) [SI]
    rise: float  # from 10 to 90 % [s]
    overshoot: float  # as a fraction of the step
    settling: float  # last time outside +-2 % [s], nan if never inside
    steady_error: float  # reference minus output at the end [SI]
    crosstalk: float  # largest change of another channel, as a fraction of the step
    command_peak: float  # largest change of a command [SI]


def step_response(loop: FrameMap, point: OperatingPoint, channel: int) -> StepResponse:
    """The loop's response to the step that it declares of the reference of a channel, given by its index."""
    machine, size = loop.robot.machine, loop.loop.step
    rows = np.tile(point.references, (BEFORE + AFTER, 1))
    rows[BEFORE:, channel] += size
    signals = np.zeros((len(rows) * machine.slots, loop.width))
    loop.run(point.state, rows, ticks=signals)
    output = signals[:, loop.signals[loop.loop.output]]
    time = machine.slot * (np.arange(len(signals)) + 1) - BEFORE * machine.frame
    later = time > 0.0
    share = (output[later, channel] - point.output[channel]) / size
    info: Any = {"RiseTime": np.nan, "Overshoot": 0.0, "SettlingTime": np.nan}
    if share.max() >= 0.9:  # below, python-control finds no rise time and raises
        info = control.step_info(share, time[later], final_output=1.0, SettlingTimeThreshold=BAND)
    command = signals[:, loop.signals[loop.loop.command]]
    others = np.delete(np.abs(output - point.output), channel, axis=1)
    return StepResponse(
        loop.channels[channel], size, time, output, info["RiseTime"], info["Overshoot"] / 100.0, info["SettlingTime"],
        steady_error=float(rows[-1, channel] - output[-1, channel]),
        crosstalk=float(others.max(initial=0.0) / abs(size)), command_peak=float(np.abs(command - command[0]).max()),
    )  # fmt: skip


def linear_error(model: FrameModel, step: StepResponse) -> float:
    """RMS distance of a step's output from that of the linear model, as a share of the step."""
    loop, j = model.loop, model.loop.channels.index(step.channel)
    frames = step.output[loop.robot.machine.slots - 1 :: loop.robot.machine.slots][BEFORE:, j] - model.point.output[j]
    system = model.system[model.rows(loop.loop.output)[j], j]
    linear = control.step_response(system, system.dt * np.arange(len(frames))).outputs
    return float(np.sqrt(np.mean((frames / step.size - linear) ** 2)))


def list_departures(model: FrameModel, steps: tuple[StepResponse, ...], whose: str = "") -> list[str]:
    """Steps that the linear model of a stable loop does not describe, a sentence each."""
    unit = model.loop.robot.machine.signal[model.loop.loop.output].unit
    return [
        f"a step of {step.size:g} {unit} on {step.channel}{whose} differs from that of the linear model by "
        f"{percent(error)} RMS, as where a command or a speed reaches its limit: margins hold for smaller ones"
        for step in steps
        if model.decides and model.spectral_radius < 1.0 and (error := linear_error(model, step)) >= BENT
    ]


def returns(loop: FrameMap, point: OperatingPoint) -> bool:
    """Whether the nonlinear loop comes back to rest, to within 1 %, after a reference of a tenth of a step for a frame.

    A loop that this does not move gets the whole step. One that rests farther than a step from where it was, as at a
    limit of its commands, has not come back.
    """
    for kick in (KICK, HARD):
        rows = np.tile(point.references, (KICKED, 1))
        rows[0] += kick * loop.loop.step
        output = loop.run(point.state, rows)[1][:, loop.signals[loop.loop.output]]
        speed = np.abs(np.diff(output, axis=0)).max(axis=1)
        if speed.max() > 1e-6 * loop.loop.step:
            away = np.abs(output[-1] - point.output).max()
            return bool(speed[-50:].max() < 0.01 * speed.max() and away < loop.loop.step)
    return True


@short_repr
@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Frequency response from reference to reading of one channel; arrays are (lines,)."""

    channel: str
    frequency: np.ndarray  # [Hz]
    measured: np.ndarray = field(repr=False)  # complex mean over the draws
    spread: np.ndarray = field(repr=False)  # standard deviation over them
    coherence: np.ndarray = field(repr=False)  # share of the reading's power that the reference explains
    linear: np.ndarray = field(repr=False)  # complex, from the frame map
    bandwidth: float  # -3 dB against the frame map's static gain [Hz], from that map if poles decide; nan if none
    bandwidth_measured: float  # the same from the multisine


def multisine(rms: float, lines: np.ndarray, period: int, rng: np.random.Generator) -> np.ndarray:
    """One period (period,) [SI] with equal power on the harmonics `lines` (n,) [-], random phases and this rms [SI]."""
    spectrum = np.zeros(period // 2 + 1, complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    signal = np.fft.irfft(spectrum, period)
    return signal * rms / np.sqrt(np.mean(signal**2))


def frequency_response(model: FrameModel, channel: int, seed: int | None = None) -> FrequencyResponse:
    """Frequency response of a channel, by its index, from its reference to its reading.

    The multisine repeats: its second period is periodic and free of leakage. What varies between draws of its phases is
    noise and nonlinearity; even distortion falls on even lines, which carry no signal (Pintelon and Schoukens, System
    Identification, ch. 2 to 4). With the seed of the sensors' noise readings are rounded, too; without, neither.
    """
    loop, point, lines, rng = model.loop, model.point, LINES, np.random.default_rng(PHASES)
    frame = loop.robot.machine.frame
    if seed is not None:
        loop = replace(loop, parameters=prepare_values(loop.robot))
    sent, read = np.zeros((DRAWS, len(lines)), complex), np.zeros((DRAWS, len(lines)), complex)
    for draw in range(DRAWS):  # the first period is thrown away as transient
        rows = np.tile(point.references, (2 * PERIOD, 1))
        rows[:, channel] += np.tile(multisine(RMS * loop.loop.step, lines, PERIOD, rng), 2)
        _, signals = loop.run(point.state, rows, None if seed is None else seed + draw)
        reading = signals[PERIOD:, loop.signals[loop.loop.measured]][:, channel]
        sent[draw], read[draw] = np.fft.rfft(rows[PERIOD:, channel])[lines], np.fft.rfft(reading)[lines]
    frequency = lines / (PERIOD * frame)
    ratio = read / sent
    cross, power = (read * sent.conj()).mean(0), (np.abs(sent) ** 2).mean(0) * (np.abs(read) ** 2).mean(0)
    coherence = np.divide(np.abs(cross) ** 2, power, out=np.full(len(lines), np.nan), where=power > 0.0)
    fine = np.linspace(0.0, 0.5 / frame, 2001)
    own = model.system[model.rows(loop.loop.measured)[channel], channel]
    linear, finely = evaluate(own, frequency)[:, 0, 0], evaluate(own, fine)[:, 0, 0]
    static = 0.0 if model.marginal else float(abs(finely[0]))  # a joint that friction holds answers by rounding
    measured = bandwidth(frequency, static, ratio.mean(0))
    return FrequencyResponse(
        loop.channels[channel], frequency, ratio.mean(0), ratio.std(0, ddof=1), coherence, linear,
        bandwidth(fine, static, finely) if model.decides else measured, measured,
    )  # fmt: skip


def bandwidth(frequency: np.ndarray, static: float, response: np.ndarray) -> float:
    """Lowest frequency [Hz] at which a response (n,) is 3 dB below its static gain; NaN if none, or if the first is."""
    share = np.abs(response) / static if static > 0.0 else np.zeros(1)
    return first_crossing(frequency, -share, -HALF_POWER) if share[0] >= HALF_POWER else float("nan")
