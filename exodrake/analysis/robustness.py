"""Robustness of a loop with all its commands at once, its bands over populations, and the robots of a diagnosis.

Populations are drawn within the tolerances of the robot file, or within the intervals of a diagnosis.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import control
import numpy as np
from scipy.optimize import least_squares, minimize
from scipy.special import ndtri

from exodrake.analysis.limit_cycles import LimitCycles, find_dead_band, limit_cycles
from exodrake.analysis.linear_model import FrameModel, compute_noise, linearise_robot
from exodrake.analysis.margins import decibel, disk_margin, loop_margins, open_loop, open_responses
from exodrake.analysis.responses import StepResponse, returns, step_response
from exodrake.core.confidence import NORMAL_90
from exodrake.core.errors import InputError, short_repr
from exodrake.model.robot import Robot, drawn_robot

POINTS = 240  # frequencies; all margins are read between them by straight lines
SLOWEST = 4e-5  # lowest frequency, as a share of the Nyquist frequency
WEIGHT_POINTS, WEIGHT_SLOWEST = 120, 1e-3  # the same of the weight
ENDS = 2  # robots at the ends of the intervals, of which limit cycles are predicted
LESS = 0.9  # second order is taken where it covers the deviation with less than this share of the first order's excess


@short_repr
@dataclass(frozen=True, eq=False)
class Robustness:
    """Robustness of one robot at one operating point."""

    label: str
    stable: bool | None  # all poles lie inside the unit circle; None where they do not decide (`FrameModel.decides`)
    frequency: np.ndarray  # (f,) [Hz]
    loops: np.ndarray  # (f, channels) open loop of each channel, the others closed
    sigma_s: np.ndarray  # (f,) largest singular value of S at the commands, and of T = I - S
    sigma_t: np.ndarray
    disk: np.ndarray  # (f,) disk margin for all commands at once
    gain_array: np.ndarray  # (f, channels) diagonal of the relative gain array
    numbers: dict[str, float]  # by name [SI], NaN where the loop is not stable
    steps: tuple[StepResponse, ...]  # nonlinear, of each channel


@short_repr
@dataclass(frozen=True, eq=False)
class Band:
    """A population: what was varied, its members, and why others have no operating point, a sentence each."""

    name: str
    members: tuple[Robustness, ...]
    failures: tuple[str, ...] = ()

    def range(self, number: str) -> tuple[float, float]:
        """Least and largest value of a number over the stable members; NaN without any."""
        values = [m.numbers[number] for m in self.members if np.isfinite(m.numbers[number])]
        return (min(values), max(values)) if values else (np.nan, np.nan)

    @property
    def unstable(self) -> int:
        """Number of unstable members."""
        return sum(m.stable is False for m in self.members)

    @property
    def undecided(self) -> int:
        """Number of members whose poles do not decide."""
        return sum(m.stable is None for m in self.members)


def relative_gains(plant: np.ndarray) -> np.ndarray:
    """Diagonal (f, channels) [-] of Bristol's array |G * inv(G)^T| of a plant G (f, channels, channels)."""
    return np.abs(np.einsum("fii,fii->fi", plant, np.linalg.pinv(plant)))


def robustness(model: FrameModel, label: str = "") -> Robustness:
    """Robustness of a loop at an operating point."""
    loop, whole, eye = model.loop, open_loop(model), np.eye(len(model.loop.channels))
    frequency = np.geomspace(SLOWEST, 1.0, POINTS) * 0.5 / whole.dt
    ratio, plant = open_responses(whole, frequency)
    s = np.linalg.inv(eye + ratio)
    loops = 1.0 / np.einsum("fii->fi", s) - 1.0
    t, disk, stable = eye - s, disk_margin(s), model.spectral_radius < 1.0 if model.decides else None
    sigma = np.linalg.norm(s, 2, axis=(1, 2)), np.linalg.norm(t, 2, axis=(1, 2))
    gains, steps = relative_gains(plant), tuple(step_response(loop, model.point, j) for j in range(len(eye)))
    numbers = {"max sigma(S)": sigma[0].max(), "max sigma(T)": sigma[1].max(), "disk margin": disk.min()}
    for j, name in enumerate(loop.channels):
        _, gain, phase, _, late = loop_margins(frequency, loops[:, j]) if stable else (np.nan,) * 5
        numbers[f"gain margin {name} [dB]"] = decibel(gain)
        numbers[f"phase margin {name} [deg]"] = phase
        numbers[f"delay margin {name} [s]"] = late
        numbers[f"disk margin {name}"] = disk_margin(s[:, j : j + 1, j : j + 1]).min()
        numbers[f"relative gain {name}"] = gains[0, j]
    if stable:
        command, rows = loop.loop.command, model.rows(loop.loop.command)
        kind, unit = loop.kinds[command], loop.robot.machine.signal[command].unit
        noises = compute_noise(model.system.A, model.N, model.system.C[rows], model.M[rows])
        for name, noise, step in zip(loop.channels, noises, steps):
            numbers[f"noise of {kind} {name} [{unit}]"] = noise
            numbers[f"settling {name} [s]"], numbers[f"overshoot {name}"] = step.settling, step.overshoot
    else:
        numbers = dict.fromkeys(numbers, np.nan)
    numbers = {name: float(value) for name, value in numbers.items()} | {"spectral radius": model.spectral_radius}
    return Robustness(label, stable, frequency, loops, *sigma, disk, gains, numbers, steps)


def points_band(robot: Robot) -> Band:
    """Robustness at each operating point that the machine names."""
    points = robot.machine.loop.points if robot.machine.loop else {}
    return band("operating points", ((label, robot) for label in points), at_label=True)


def band(
    name: str, robots: Iterable[tuple[str, Robot]], at: Mapping[str, float] | str | None = None, at_label: bool = False
) -> Band:
    """Robustness of each labelled robot at an operating point, or at that of its label; those without fail."""
    found, failures = [], []
    for label, robot in robots:
        try:
            found.append(robustness(linearise_robot(robot, label if at_label else at), label))
        except InputError as problem:
            failures.append(f"{label}: {problem}")
    return Band(name, tuple(found), tuple(failures))


def within_tolerances(robot: Robot, draws: int, seed: int = 0) -> Iterator[tuple[str, Robot]]:
    """Robots within the tolerances, with labels."""
    for k in range(draws):
        yield f"draw {k + 1}", drawn_robot(robot, np.random.default_rng([seed, k]))


def within_intervals(
    robot: Robot, answer: Mapping[str, Any], draws: int, seed: int = 0, ends: tuple[float, ...] = (-1.0, 1.0)
) -> Iterator[tuple[str, Robot]]:
    """Robots within the 90 % intervals of the effects that a diagnosis named, with labels.

    The robot is the improved one of that diagnosis, or the nominal one; the answer as `exodrake diagnose --json` writes
    it. Each parameter is normal on either side of its value, and inside its interval; the first robots have all
    parameters at `ends` of the intervals: -1 lower, 0 the estimate, 1 upper.

    Raises:
        InputError: the answer has no effects, or names parameters that the robot lacks.
    """
    effects = answer.get("effects") if isinstance(answer, Mapping) else None
    if not isinstance(effects, list) or not effects:
        raise InputError("no effect to draw intervals of: wanted an answer of exodrake diagnose --json that names one")

    def draw(interval: Mapping[str, Any], end: float | None, rng: np.random.Generator) -> float:
        # inside its 90 % interval, since tails could leave what a robot can be; an unknown end is the estimate
        x = float(ndtri(rng.uniform(0.05, 0.95))) / NORMAL_90 if end is None else end
        value, other = interval["value"], interval["high" if x > 0.0 else "low"]
        return value if other is None else value + abs(x) * (other - value)

    for k in range(draws):
        drawn, end, rng = robot, ends[k] if k < len(ends) else None, np.random.default_rng([seed, k])
        for effect in effects:
            try:
                stated = {n: i for n, i in effect["parameters"].items() if i["value"] is not None}
                values: dict[str, Any] = {n: draw(i, end, rng) for n, i in stated.items()}
                values |= {n: {c: draw(i, end, rng) for c, i in at.items()} for n, at in effect["channels"].items()}
                drawn = drawn.splice(effect["id"], values, [*effect["wires"], *effect["joints"]])
            except (KeyError, TypeError, AttributeError):
                raise InputError("the diagnosis states an effect without id, parameters and intervals") from None
        yield f"draw {k + 1}" if end is None else ("lower ends", "estimate", "upper ends")[int(end) + 1], drawn


@short_repr
@dataclass(frozen=True, eq=False)
class Uncertainty:
    """The robots of a diagnosis' answer in the loop."""

    band: Band  # figures of the robots, and why others have no operating point
    unstable: tuple[str, ...]  # labels of those whose loop is not stable, by a kick where their poles mean little
    dead_band: dict[str, float]  # log column -> half the range in which it may rest [SI], the worst of the robots
    # on each channel of the improved robot, then of the intervals' ends; empty if it is smooth at rest
    cycles: tuple[LimitCycles, ...]
    frequency: np.ndarray  # (f,) [Hz]
    deviation: np.ndarray  # (f,) largest relative deviation of a plant from the improved one's [-]
    weight: control.TransferFunction  # in s, of order 1 or 2, covers the deviation
    peak: float  # largest |weight| max sigma(T): below 1 every plant within the weight is stable; nan if T means little

    @property
    def gain_margin_db(self) -> float:
        """Worst describing-function gain margin over amplitudes and intervals [dB]; nan without nonlinearities."""
        return min((c.gain_margin_db for c in self.cycles), default=np.nan)

    def list_worst(self, margin: str) -> tuple[LimitCycles, ...]:
        """Cycles of the channel whose margin of that name is least: the improved robot's, then those of the ends."""
        least = min(self.cycles, key=attrgetter(margin), default=None)
        return tuple(c for c in self.cycles if least and c.channel == least.channel)

    @property
    def phase_margin_deg(self) -> float:
        """Worst describing-function phase margin over amplitudes and intervals [deg]; nan without nonlinearities."""
        return min((c.least_phase_deg for c in self.cycles), default=np.nan)

    def to_dict(self) -> dict[str, Any]:
        """All numbers as plain data; the weight by its coefficients in s, the highest power first."""
        num, den = (np.asarray(c[0][0]).tolist() for c in (self.weight.num, self.weight.den))
        counts = {"robots": len(self.band.members), "kicked": self.band.undecided, "failures": self.band.failures}
        worst = {"gain_margin_db": self.gain_margin_db, "phase_margin_deg": self.phase_margin_deg}
        own = {name: value for name, value in vars(self).items() if name != "band"}
        return counts | own | worst | {"weight": {"numerator": num, "denominator": den}}


def assess_answer(
    robot: Robot, answer: Mapping[str, Any], at: Mapping[str, float] | str | None = None, draws: int = 12
) -> Uncertainty:
    """Stability, margins over amplitude, dead band and uncertainty weight over the robots of a diagnosis' answer.

    For control the answer is every plant P_i with |P_i - P| <= |w| |P|: robustly stable if |w| max sigma(T) < 1 at
    every frequency. Where friction or a dead zone leaves no linear response, the describing functions of the ends of
    the intervals take its place. Robot and answer are as for `within_intervals`, whose ends are among the `draws`.

    Raises:
        InputError: the answer names no effect, or the improved robot has no loop or no state of rest.
    """
    ((_, improved),) = within_intervals(robot, answer, 1, ends=(0.0,))
    model = linearise_robot(improved, at)
    frequency = np.geomspace(WEIGHT_SLOWEST, 1.0, WEIGHT_POINTS) * 0.5 / model.system.dt
    ratio, nominal = open_responses(open_loop(model), frequency) if model.decides else (None, None)
    members, unstable, failures, deviations = [], [], [], []
    dead_band, cycles = find_dead_band(model.loop, model.point), list(limit_cycles(improved, at, own_only=True))
    for k, (label, drawn) in enumerate(within_intervals(robot, answer, draws)):
        try:
            there = linearise_robot(drawn, at)
            members.append(robustness(there, label))
        except InputError as problem:
            failures.append(f"{label}: {problem}")
            continue
        if not (there.spectral_radius < 1.0 if there.decides else returns(there.loop, there.point)):
            unstable.append(label)
        dead_band = {n: max(b, dead_band[n]) for n, b in find_dead_band(there.loop, there.point).items()}
        if nominal is not None and there.decides:
            change = open_responses(open_loop(there), frequency)[1] - nominal
            deviations.append(np.linalg.norm(change @ np.linalg.pinv(nominal), 2, axis=(1, 2)))
        elif k < ENDS:
            cycles += limit_cycles(drawn, at, own_only=True)
    if nominal is None and cycles:
        frequency, first, own = cycles[0].line_frequency, cycles[0].measured, cycles[0].channel
        moves = (first != 0.0).all(axis=1)  # amplitudes at which friction lets go
        changes = [c.measured[moves] / first[moves] - 1.0 for c in cycles if c.channel == own]
        deviations = [np.abs(change).max(axis=0, initial=0.0) for change in changes]
    deviation = np.max(deviations, axis=0) if deviations else np.zeros(len(frequency))
    weight, peak = fit_weight(frequency, deviation), np.nan
    if nominal is not None and ratio is not None:
        t = nominal @ np.linalg.solve(np.eye(ratio.shape[-1]) + ratio, ratio) @ np.linalg.pinv(nominal)
        peak = float((np.abs(weight(2j * np.pi * frequency)) * np.linalg.norm(t, 2, axis=(1, 2))).max())
    population = Band("diagnosis", tuple(members), tuple(failures))
    return Uncertainty(population, tuple(unstable), dead_band, tuple(cycles), frequency, deviation, weight, peak)


def fit_weight(frequency: np.ndarray, deviation: np.ndarray) -> control.TransferFunction:
    """The weight g ((s / a + 1) / (s / b + 1))^n, n 1 or 2, that covers a deviation (f,) [-] at frequencies (f,) [Hz].

    Of all that cover it, it exceeds the deviation least in the mean of the logarithms.
    """
    w = 2.0 * np.pi * frequency
    log_size = np.log(np.maximum(deviation, 1e-6))

    def excess(x: np.ndarray, order: int) -> np.ndarray:
        lags = np.log1p((w / np.exp(x[1])) ** 2) - np.log1p((w / np.exp(x[2])) ** 2)
        return x[0] + 0.5 * order * lags - log_size

    def above(x: np.ndarray, order: int) -> float:
        return float(np.mean(excess(x, order) - excess(x, order).min()))

    middle, (low, high) = np.log(np.sqrt(w[0] * w[-1])), np.log([w[0] / 10.0, 10.0 * w[-1]])
    starts = [(log_size[0], middle + a, middle + b) for a, b in ((-1.0, 1.0), (1.0, -1.0), (1.0, 3.0), (-3.0, 0.0))]
    bounds, tried = ([-20.0, low, low], [20.0, high, high]), []
    for order in (1, 2):
        fits = [least_squares(excess, start, args=(order,), bounds=bounds) for start in starts]
        x = min(fits, key=lambda fit: fit.cost).x
        found = minimize(above, x, args=(order,), method="Nelder-Mead", bounds=np.transpose(bounds))
        tried.append((found.fun, found.x - np.array([excess(found.x, order).min(), 0.0, 0.0]), order))
    _, (gain, zero, pole), order = tried[1] if tried[1][0] < LESS * tried[0][0] else tried[0]
    s = control.tf("s")
    return np.exp(gain) * ((s / np.exp(zero) + 1.0) / (s / np.exp(pole) + 1.0)) ** order
