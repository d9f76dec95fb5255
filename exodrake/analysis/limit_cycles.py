"""Limit cycles of one channel's loop from rounding, dead zones and friction: predicted and simulated.

A cycle is predicted at the factor g on the loop gain for which g K N(a, f) = -1, with the linear controller K and the
describing function N from command to reading; where g grows with the amplitude a, it is stable. python-control's
`describing_function_response` knows static nonlinearities alone; here N depends on frequency and schedule.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import control
import numpy as np

from exodrake.analysis import margins as mg
from exodrake.analysis.linear_model import FrameMap, FrameModel, OperatingPoint, linearise_robot
from exodrake.core.errors import short_repr
from exodrake.engine.inputs import prepare_values
from exodrake.model.robot import Robot

WINDOW = 60  # frames in which the harmonic is measured, after as many of transient
CYCLES = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 16, 18, 21, 24)  # of the sine in the window
AMPLITUDES = np.geomspace(2e-3, 10.0, 12)  # of the command, in units of its answer to a step of the reference
FACTORS = (0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 1.05, 1.1, 1.2, 1.3)  # simulated factors, in units of the gain margin
RUN, SEEN = 1000, 250  # frames simulated; last ones in which an oscillation is measured
RAMP = 6000  # frames in which a reference is approached: slow, or what relaxes after it narrows the dead band
BELOW = 2.0  # the crossover lies above the lowest line by this factor
LEAST = 1e-4  # of the open loop where it crosses the real axis, below which it does not
UNBOUNDED = 1e3  # amplitude of a command that grows without bound, in the same unit
FAINT = 1e-3  # amplitude below which nothing oscillates, in units of the smallest one tried


@short_repr
@dataclass(frozen=True, eq=False)
class LimitCycles:
    """Limit cycles of one nonlinearity, its `label`, in the loop of one channel."""

    label: str
    channel: str
    unit: str  # of the command
    limit: float  # linear gain margin of that loop without the nonlinearity
    amplitude: np.ndarray  # (k,) of the command [SI], for which a limit cycle is predicted
    factor: np.ndarray  # (k,) on the loop gain [-], and frequency (k,) [Hz]; nan where L never turns by 180 degrees
    frequency: np.ndarray
    phase_margin_deg: np.ndarray  # (k,) with the describing function of each amplitude; inf without crossover
    measured: np.ndarray  # (k, lines) describing functions from command to reading
    line_frequency: np.ndarray  # (lines,) [Hz]
    factors: np.ndarray  # (m,) on the loop gain that are simulated [-]
    swing: np.ndarray  # (m,) simulated amplitude of the command [SI]; 0 at rest, inf where it grows without bound
    swing_frequency: np.ndarray  # (m,) [Hz]; 0 at rest, nan where it grows without bound

    @property
    def gain_margin_db(self) -> float:
        """Describing-function gain margin [dB] at the worst amplitude; inf where no amplitude has a limit."""
        return float(mg.decibel(np.nanmin(self.factor, initial=np.inf)))

    @property
    def least_phase_deg(self) -> float:
        """Describing-function phase margin [deg] at the worst amplitude; inf where no amplitude has a crossover."""
        return float(np.nanmin(self.phase_margin_deg))

    def read_simulation(self) -> tuple[float, float]:
        """Amplitude [SI] and frequency [Hz] of the simulated command with the robot's own gains; 0 and 0 at rest."""
        k = int(np.flatnonzero(self.factors == 1.0)[0])
        return float(self.swing[k]), float(self.swing_frequency[k])


@dataclass(frozen=True, eq=False)
class CommandedLoop:
    """The frame map with the command of one channel set from outside; the controller goes on as if it were its own."""

    loop: FrameMap
    references: np.ndarray  # (channels,) under which it rests [SI]
    direct: np.ndarray  # (channels, channels) dv/dr of its controller
    channel: int

    @property
    def unit(self) -> float:
        """The command's answer to a step of the reference [SI]."""
        return abs(self.direct[self.channel, self.channel]) * self.loop.loop.step

    def sweep(self, state: np.ndarray, amplitude: float, lines: list[tuple[int, int]]) -> np.ndarray:
        """Describing functions (lines,) at an amplitude [SI] and lines (cycles, frames)."""
        return np.array([describing_function(self, state, amplitude, *line) for line in lines])

    def run(self, state: np.ndarray, frames: int, rule: Callable[[int, float], float]) -> tuple[np.ndarray, np.ndarray]:
        """Command and reading (frames,) [SI] of the channel under a rule (frame, command of the controller) -> command.

        A reference is found that makes the controller send that command; its states then take the values that they
        have with the reference at rest, which the reading alone decides.
        """
        run, inverse = self.loop.run, np.linalg.inv(self.direct)
        command, reading = (
            self.loop.signals[s].start + self.channel for s in (self.loop.loop.command, self.loop.loop.measured)
        )
        x, rows = state, np.zeros((frames, 2))
        for n in range(frames):
            after, signals = run(x, self.references[None])
            sent = signals[0, command]
            change = np.zeros(len(self.references))
            change[self.channel] = rule(n, float(sent)) - sent
            x, signals = run(x, (self.references + inverse @ change)[None])
            x[self.loop.own] = after[self.loop.own]
            rows[n] = signals[0, command], signals[0, reading]
        return rows[:, 0], rows[:, 1]


def describing_function(
    plant: CommandedLoop, state: np.ndarray, amplitude: float, cycles: int, window: int = WINDOW
) -> complex:
    """First harmonic of the reading over that of the command, a cosine of so many cycles in a window of frames.

    A cosine of an amplitude [SI] moves the actuator about its state of rest (states,) [SI], a sine to one side. Its
    harmonics are fitted by least squares (Gelb, Vander Velde 1968).
    """
    phase = 2.0 * np.pi * cycles / window * np.arange(2 * window)
    command, reading = plant.run(state, 2 * window, lambda n, _: amplitude * np.cos(phase[n]))
    basis = np.column_stack([np.cos(phase), np.sin(phase), phase, np.ones_like(phase)])[window:]  # a drift, too
    harmonic = np.linalg.lstsq(basis, np.column_stack([command, reading])[window:], rcond=None)[0][:2]
    sent, read = harmonic[0] - 1j * harmonic[1]
    return complex(read / sent)


def limit_cycles(
    robot: Robot, at: Mapping[str, float] | str | None = None, own_only: bool = False
) -> tuple[LimitCycles, ...]:
    """Limit cycles of the robot, on each channel that its effects sit on, and of each nonlinearity its loop names.

    These are on the channel with the least gain margin. Effects of the robot that are smooth where it rests belong to
    its linear loop; where they are not, or let no command through to its reading, that loop is without them, and they
    are the first nonlinearity. The reading is rounded at the edge between two values, its worst place. None for a loop
    that is unstable without nonlinearities, has no gain margin, or whose reading does not answer to its command. With
    `own_only`, none of the nonlinearities but the robot's own effects.
    """
    for plain in (robot, robot.without_effects()):
        model = linearise_robot(plain, at)
        whole = mg.open_loop(model)
        grid, opened = mg.frequency_grid(whole), [mg.open_channel(whole, j) for j in range(whole.ninputs)]
        ratios = [mg.open_responses(one, grid)[0][:, 0, 0] for one in opened]
        if model.decides and all(ratio.any() for ratio in ratios):
            break
    if model.spectral_radius >= 1.0:
        return ()
    loop, own = model.loop.loop, robot.effects()
    margins = [mg.loop_margins(grid, ratio)[1] if ratio.any() else np.inf for ratio in ratios]
    least = int(np.argmin(margins))
    nonlinear: list[tuple[str, Robot, bool, int]] = []
    if own and plain is not robot:
        nulls = {e.id: e.parameters[0].null for e in robot.machine.effects}
        sits = {c for i, p in own.items() for c, value in next(iter(p.values())).items() if value != nulls[i]}
        on = [j for j, channel in enumerate(model.loop.channels) if channel in sits]
        nonlinear += [(" + ".join(own), robot, False, j) for j in on or [least]]
    if not own_only:
        if loop.resolution and plain.channels(loop.resolution).max() > 0.0:
            nonlinear.append((f"rounding, {loop.resolution}", plain, True, least))
        further = {name: values for name, values in loop.nonlinear.items() if name not in own}
        nonlinear += [(name, plain.splice(name, values), False, least) for name, values in further.items()]
    found = []
    for channel in {j: None for *_, j in nonlinear if np.isfinite(margins[j])}:
        crossover = mg.loop_margins(grid, ratios[channel])[3]
        longer = int(np.ceil(BELOW / (WINDOW * whole.dt * crossover))) if crossover > 0.0 else 1
        lines = [*((n, longer * WINDOW) for n in range(1, longer)), *((n, WINDOW) for n in CYCLES)]
        direct = model.system.D[model.rows(loop.command)]
        plant = CommandedLoop(model.loop, model.point.references, direct, channel)
        response = plant.sweep(model.point.state, plant.unit * AMPLITUDES[0], lines)
        if not response.all():
            continue
        frequency = np.array([n / (window * whole.dt) for n, window in lines])
        law = mg.open_responses(opened[channel], frequency)[0][:, 0, 0] / response
        linear = model, plant, margins[channel], lines, frequency, law
        mine = [(label, one, rounded) for label, one, rounded, j in nonlinear if j == channel]
        found += [compare_cycles(label, one, *linear, rounded) for label, one, rounded in mine]
    return tuple(found)


def compare_cycles(
    label: str, robot: Robot, model: FrameModel, plant: CommandedLoop, limit: float, lines: list[tuple[int, int]],
    frequency: np.ndarray, law: np.ndarray, rounded: bool,
) -> LimitCycles:  # fmt: skip
    """Predicted and simulated limit cycles of a robot with a nonlinearity, whose readings may be rounded.

    Model and plant are of the loop without it, `limit` the gain margin of the channel there [-], `law` (lines,) the
    controller from readings to commands [command / reading] at lines of (cycles, frames) and `frequency` (lines,) [Hz].
    """
    references, state, channel = model.point.references, model.point.state, plant.channel
    loop = FrameMap.from_robot(robot)
    if rounded:
        edge = np.zeros(len(references))
        edge[channel] = 0.5 * np.broadcast_to(robot.channels(loop.loop.resolution), len(edge))[channel]
        references = references + edge
        state, _ = loop.run(state, np.tile(references, (RUN, 1)))
        loop = replace(loop, parameters=prepare_values(loop.robot))
    plant = replace(plant, loop=loop, references=references)
    unit, dt = plant.unit, model.system.dt
    measured = np.array([plant.sweep(state, a, lines) for a in unit * AMPLITUDES])
    curve = [(*find_crossing(frequency, law * n), mg.loop_margins(frequency, law * n)[2]) for n in measured]
    factors, swings = np.sort(np.append(limit * np.array(FACTORS), 1.0)), []
    for g in factors:
        with np.errstate(all="ignore"):  # without saturation an unstable loop leaves the range of numbers
            command, _ = plant.run(state, RUN, lambda n, v, g=g: g * v + (unit if n == 0 else 0.0))
        if not np.ptp(command) < UNBOUNDED * unit:  # of the whole run: readings stop at the largest integer
            swings.append((np.inf, np.nan))
            continue
        tail = command[-SEEN:] - command[-SEEN:].mean()
        swing = float(np.sqrt(2.0) * tail.std())
        k = int(np.abs(np.fft.rfft(tail * np.hanning(SEEN)))[1:].argmax()) + 1
        swings.append((0.0, 0.0) if swing < FAINT * unit * AMPLITUDES[0] else (swing, k / (SEEN * dt)))
    return LimitCycles(
        label, loop.channels[channel], loop.robot.machine.signal[loop.loop.command].unit, limit, unit * AMPLITUDES,
        *np.array(curve).T, measured, frequency, factors, *np.array(swings).T,  # pyright: ignore
    )  # fmt: skip


def find_crossing(frequency: np.ndarray, response: np.ndarray) -> tuple[float, float]:
    """Least factor that puts a response (f,) on -1, and the frequency [Hz] where; nan and nan if none does."""
    gains, _, _, turns, _, _ = control.stability_margins(control.frd(response, 2.0 * np.pi * frequency), returnall=True)
    seen = [(g, w / (2.0 * np.pi)) for g, w in zip(gains, turns) if 0.0 < g < 1.0 / LEAST]
    return min(seen, default=(np.nan, np.nan))


def find_dead_band(loop: FrameMap, point: OperatingPoint) -> dict[str, float]:
    """Half the range in which each logged signal may rest under the same references: log column -> [SI].

    Every reference is approached by a slow ramp from below and from above, one channel at a time. A P loop with a dead
    zone w of its command rests within w / kp of its reference.
    """
    band = np.zeros(len(loop.outputs))
    for channel in range(len(loop.channels)):
        ends = []
        for side in (-1.0, 1.0):
            rows = np.tile(point.references, (RAMP + RUN, 1))
            rows[:RAMP, channel] += np.linspace(side * loop.loop.step, 0.0, RAMP)
            ends.append(loop.run(point.state, rows)[1][-1, list(loop.outputs.values())])
        band = np.maximum(band, 0.5 * np.abs(ends[1] - ends[0]))
    return dict(zip(loop.outputs, band.tolist(), strict=True))
