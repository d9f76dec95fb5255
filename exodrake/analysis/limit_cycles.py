"""Limit cycles of one channel's loop from rounding, dead zones and friction: predicted and simulated.

The describing function N(a, f) between command and reading is measured: a sine of amplitude a and frequency f replaces
the channel's command, and the first harmonic of its reading is fitted (Gelb, Vander Velde 1968). With the linear
controller K a limit cycle is predicted at the factor g on the loop gain for which g K N(a, f) = -1. Where g grows with
a, it is stable. The closed loop with that factor is then simulated after a kick. python-control knows describing
functions of static nonlinearities alone; here N depends on the frequency, too, and rests on the frame's schedule.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.linear_model import FrameModel, OperatingPoint, linearise_robot
from exodrake.analysis.margins import frequency_grid, loop_margins, open_loop, plant_response, return_ratio, single
from exodrake.compiled.inputs import prepared
from exodrake.core.robot import Robot

WINDOW = 60  # frames in which the harmonic is measured, after as many of transient
CYCLES = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 16, 18, 21, 24)  # of the sine in the window
AMPLITUDES = np.geomspace(2e-3, 10.0, 12)  # of the command, in units of its answer to a step of the reference
FACTORS = (0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 1.05, 1.1, 1.2, 1.3)  # simulated factors, in units of the gain margin
RUN, SEEN = 1000, 250  # frames simulated; last ones in which an oscillation is measured
LEAST = 1e-4  # of the open loop where it crosses the real axis, below which it does not
UNBOUNDED = 1e3  # amplitude of a command that grows without bound, in the same unit
FAINT = 1e-3  # amplitude below which nothing oscillates, in units of the smallest one tried


@dataclass(frozen=True, eq=False)
class LimitCycles:
    """Limit cycles of one nonlinearity.

    Attributes:
        label: name of the nonlinearity.
        channel: channel whose loop it is.
        unit: unit of the command.
        limit: linear gain margin of that loop without the nonlinearity.
        amplitude: (k,) amplitudes of the command [SI] for which a limit cycle is predicted.
        factor: (k,) factor on the loop gain at each amplitude [-]; nan where L never turns by 180 degrees.
        frequency: (k,) frequency at each amplitude [Hz]; nan like the factor.
        factors: (m,) factors on the loop gain that are simulated [-].
        swing: (m,) simulated amplitude of the command [SI]; 0 at rest, inf where it grows without bound.
        swing_frequency: (m,) its frequency [Hz]; 0 at rest, nan where it grows without bound.
    """

    label: str
    channel: str
    unit: str
    limit: float
    amplitude: np.ndarray
    factor: np.ndarray
    frequency: np.ndarray
    factors: np.ndarray
    swing: np.ndarray
    swing_frequency: np.ndarray

    def predict(self, factor: float = 1.0) -> tuple[float, float]:
        """Amplitude [SI] and frequency [Hz] of the smallest stable limit cycle at a factor; 0 and 0 without any."""
        low, high = self.factor[:-1], self.factor[1:]
        for k in np.flatnonzero((low <= factor) & (factor < high)):
            share = (factor - low[k]) / (high[k] - low[k])
            size = np.exp(np.log(self.amplitude[k]) * (1.0 - share) + np.log(self.amplitude[k + 1]) * share)
            return float(size), float(self.frequency[k] * (1.0 - share) + self.frequency[k + 1] * share)
        return 0.0, 0.0

    def read_simulation(self) -> tuple[float, float]:
        """Amplitude [SI] and frequency [Hz] of the simulated command with the robot's own gains; 0 and 0 at rest."""
        k = int(np.flatnonzero(self.factors == 1.0)[0])
        return float(self.swing[k]), float(self.swing_frequency[k])


@dataclass(frozen=True, eq=False)
class CommandedLoop:
    """The frame map with the command of one channel set from outside; the controller goes on as if it were its own.

    Attributes:
        loop: frame map, with rounding or without.
        references: (channels,) [SI] at rest.
        direct: (channels, channels) dv/dr of the controller.
        channel: index of the channel that is commanded.
    """

    loop: FrameMap
    references: np.ndarray
    direct: np.ndarray
    channel: int

    def run(self, state: np.ndarray, frames: int, rule: Callable[[int, float], float]) -> tuple[np.ndarray, np.ndarray]:
        """Command and reading (frames,) [SI] of the channel under a rule (frame, command of the controller) -> command.

        A reference is found that makes the controller send that command; its states then take the values that they
        have with the reference at rest, which the reading alone decides.
        """
        step, inverse = self.loop.stepper(), np.linalg.inv(self.direct)
        command = self.loop.signals[self.loop.loop.command]
        reading = self.loop.signals[self.loop.loop.measured].start + self.channel
        own = self.loop.own
        x, rows = state, np.zeros((frames, 2))
        for n in range(frames):
            after, signals = step(x, self.references)
            change = np.zeros(len(self.references))
            wanted = rule(n, signals[command][self.channel])
            change[self.channel] = wanted - signals[command][self.channel]
            x, commanded = step(x, self.references + inverse @ change)
            x[own] = after[own]
            rows[n] = commanded[command][self.channel], commanded[reading]
        return rows[:, 0], rows[:, 1]


def describing_function(plant: CommandedLoop, state: np.ndarray, amplitude: float, cycles: int) -> complex:
    """First harmonic of the reading over that of the command, a cosine of so many cycles in the window.

    A cosine moves the actuator about where it rests, a sine to one side.

    Args:
        plant: whose command is set.
        state: (states,) at rest [SI].
        amplitude: of the command [SI].
        cycles: in the window.
    """
    phase = 2.0 * np.pi * cycles / WINDOW * np.arange(2 * WINDOW)
    command, reading = plant.run(state, 2 * WINDOW, lambda n, _: amplitude * np.cos(phase[n]))
    basis = np.column_stack([np.cos(phase), np.sin(phase), phase, np.ones_like(phase)])[WINDOW:]  # a drift, too
    harmonic = np.linalg.lstsq(basis, np.column_stack([command, reading])[WINDOW:], rcond=None)[0][:2]
    sent, read = harmonic[0] - 1j * harmonic[1]
    return complex(read / sent)


def limit_cycles(robot: Robot, at: Mapping[str, float] | str | None = None) -> tuple[LimitCycles, ...]:
    """Limit cycles of the channel with the least gain margin, for the robot and for each nonlinearity its loop names.

    Effects of the robot that are smooth where it rests belong to its linear loop; where they are not, that loop is
    without them, and they are the first nonlinearity. The reading is rounded at the edge between two values, its worst
    place. None for a loop that is unstable without nonlinearities, or has no gain margin.
    """
    for plain in (robot, robot.without_effects()):
        loop, point, model = linearise_robot(plain, at)
        if model.decides:
            break
    if model.spectral_radius >= 1.0:
        return ()
    whole = open_loop(loop, model)
    grid, direct = frequency_grid(whole), model.D[model.rows(loop.column(loop.loop.command))]
    ratios = [return_ratio(single(whole, j), grid)[:, 0, 0] for j in range(len(loop.channels))]
    margins = [loop_margins(grid, ratio)[1] if np.abs(ratio).max() > 0.0 else np.inf for ratio in ratios]
    channel = int(np.argmin(margins))
    if not np.isfinite(margins[channel]):
        return ()
    found, own = [], robot.effects()
    if own and plain is not robot:
        found.append(compare_cycles(" + ".join(own), robot, point, whole, direct, channel, margins[channel], False))
    if loop.loop.resolution and plain.channels(loop.loop.resolution).max() > 0.0:
        label = f"rounding, {loop.loop.resolution}"
        found.append(compare_cycles(label, plain, point, whole, direct, channel, margins[channel], True))
    for identity, values in loop.loop.nonlinear.items():
        if identity not in own:
            spliced = plain.splice(identity, values)
            found.append(compare_cycles(identity, spliced, point, whole, direct, channel, margins[channel], False))
    return tuple(found)


def compare_cycles(
    label: str,
    robot: Robot,
    point: OperatingPoint,
    whole: FrameModel,
    direct: np.ndarray,
    channel: int,
    limit: float,
    rounded: bool,
) -> LimitCycles:
    """Predicted and simulated limit cycles of one robot.

    Args:
        label: of its nonlinearity.
        robot: with it.
        point: where the same robot rests without it.
        whole: linear loop without it, opened.
        direct: (channels, channels) dv/dr of the controller [command / reference].
        channel: index of the channel.
        limit: gain margin of that linear loop.
        rounded: whether readings are rounded.
    """
    loop = FrameMap.of(robot)
    loop = replace(loop, parameters=prepared(robot, quantisation=rounded))
    references, state = point.references, point.state
    if rounded:
        edge = np.zeros(len(references))
        edge[channel] = 0.5 * np.broadcast_to(robot.channels(loop.loop.resolution), len(edge))[channel]
        references = references + edge
        rows = np.tile(references, (RUN, 1))
        state = replace(loop, parameters=prepared(robot, quantisation=False)).run(state, rows)[0]
    plant = CommandedLoop(loop, references, direct, channel)
    unit = abs(direct[channel, channel]) * loop.loop.step
    frequency = np.array(CYCLES) / (WINDOW * whole.period)
    one = single(whole, channel)
    controller = return_ratio(one, frequency)[:, 0, 0] / plant_response(one, frequency)[:, 0, 0]
    curve = []
    for size in unit * AMPLITUDES:
        measured = np.array([describing_function(plant, state, size, cycles) for cycles in CYCLES])
        curve.append(find_crossing(frequency, controller * measured))
    factors = np.sort(np.append(limit * np.array(FACTORS), 1.0))
    swings = [simulate_oscillation(plant, state, g, whole.period, unit) for g in factors]
    return LimitCycles(
        label, whole.inputs[channel], loop.robot.machine.signal[loop.loop.command].unit, limit, unit * AMPLITUDES,
        *np.array(curve).T, factors, *np.array(swings).T,  # pyright: ignore
    )  # fmt: skip


def find_crossing(frequency: np.ndarray, response: np.ndarray) -> tuple[float, float]:
    """Least factor that puts a response (f,) on -1, and the frequency [Hz] where; nan and nan if none does."""
    best = (np.nan, np.nan)
    for k in range(len(frequency) - 1):
        a, b = response[k], response[k + 1]
        if a.imag * b.imag > 0.0 or a.imag == b.imag:
            continue
        share = a.imag / (a.imag - b.imag)
        real = (1.0 - share) * a.real + share * b.real
        if real < -LEAST and not -1.0 / real >= best[0]:
            best = (-1.0 / real, (1.0 - share) * frequency[k] + share * frequency[k + 1])
    return best


def simulate_oscillation(
    plant: CommandedLoop, state: np.ndarray, factor: float, period: float, unit: float
) -> tuple[float, float]:
    """Amplitude [SI] and frequency [Hz] of the command at the end of a run from a state (states,) after a kick.

    0 and 0 if it rests, inf and nan if it grows without bound.
    """
    with np.errstate(all="ignore"):  # without saturation an unstable loop leaves the range of numbers
        command, _ = plant.run(state, RUN, lambda n, v: factor * v + (unit if n == 0 else 0.0))
    if not np.ptp(command) < UNBOUNDED * unit:  # of the whole run: readings stop at the largest integer
        return np.inf, np.nan
    tail = command[-SEEN:] - command[-SEEN:].mean()
    swing = float(np.sqrt(2.0) * tail.std())
    if swing < FAINT * unit * AMPLITUDES[0]:
        return 0.0, 0.0
    spectrum = np.abs(np.fft.rfft(tail * np.hanning(SEEN)))
    k = int(spectrum[1:].argmax()) + 1
    return swing, k / (SEEN * period)
