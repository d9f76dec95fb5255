"""Robustness of a loop with all its commands at once, and its bands over a population of robots or operating points.

Populations are drawn within the tolerances of the robot file, or within the intervals of a diagnosis.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.special import ndtri

from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.linear_model import FrameModel, OperatingPoint, compute_noise, linearise_robot
from exodrake.analysis.margins import decibel, disk_margin, loop_margins, open_loop, plant_response, return_ratio
from exodrake.analysis.responses import step_response
from exodrake.core.confidence import NORMAL_90
from exodrake.core.errors import InputError
from exodrake.core.robot import Robot, drawn_robot

POINTS = 240  # frequencies; all margins are read between them by straight lines
SLOWEST = 4e-5  # lowest frequency, as a share of the Nyquist frequency


@dataclass(frozen=True, eq=False)
class Robustness:
    """Robustness of one robot at one operating point.

    Attributes:
        label: of the robot or the point.
        stable: whether all poles lie inside the unit circle; None where the poles do not decide (`FrameModel.decides`).
        frequency: (f,) [Hz].
        loops: (f, channels) open loop of each channel, the others closed.
        sigma_s, sigma_t: (f,) largest singular values of S and T = I - S at the commands.
        disk: (f,) disk margin for all commands at once.
        gain_array: (f, channels) diagonal of the relative gain array.
        numbers: name -> value, SI; NaN where the loop is not stable.
    """

    label: str
    stable: bool | None
    frequency: np.ndarray
    loops: np.ndarray
    sigma_s: np.ndarray
    sigma_t: np.ndarray
    disk: np.ndarray
    gain_array: np.ndarray
    numbers: dict[str, float]


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
    """Diagonal (f, channels) [-] of the relative gain array of a plant (f, channels, channels): 1 without coupling.

    Bristol's array G * inv(G)^T, with absolute values of the complex elements.
    """
    return np.abs(np.einsum("fii,fii->fi", plant, np.linalg.pinv(plant)))


def output_noise(model: FrameModel, rows: list[int]) -> np.ndarray:
    """Standard deviation (rows,) [SI] of some outputs, by index, under the sensors' noise, in a stable loop."""
    return compute_noise(model.system.A, model.N, model.system.C[rows], model.M[rows])


def robustness(loop: FrameMap, point: OperatingPoint, model: FrameModel, label: str = "") -> Robustness:
    """Robustness of a loop at an operating point."""
    whole, eye = open_loop(loop, model), np.eye(len(loop.channels))
    frequency = np.geomspace(SLOWEST, 1.0, POINTS) * 0.5 / whole.dt
    s = np.linalg.inv(eye + return_ratio(whole, frequency))
    loops = 1.0 / np.einsum("fii->fi", s) - 1.0
    t, disk, stable = eye - s, disk_margin(s), model.spectral_radius < 1.0 if model.decides else None
    sigma = np.linalg.norm(s, 2, axis=(1, 2)), np.linalg.norm(t, 2, axis=(1, 2))
    gains = relative_gains(plant_response(whole, frequency))
    numbers = {"max sigma(S)": sigma[0].max(), "max sigma(T)": sigma[1].max(), "disk margin": disk.min()}
    for j, name in enumerate(loop.channels):
        _, gain, phase, _, late = loop_margins(frequency, loops[:, j]) if stable else (np.nan,) * 5
        numbers[f"gain margin {name} [dB]"] = decibel(gain)
        numbers[f"phase margin {name} [deg]"] = phase
        numbers[f"delay margin {name} [s]"] = late
        numbers[f"disk margin {name}"] = disk_margin(s[:, j : j + 1, j : j + 1]).min()
        numbers[f"relative gain {name}"] = gains[0, j]
    if stable:
        kind, unit = loop.kinds[loop.loop.command], loop.robot.machine.signal[loop.loop.command].unit
        for j, (name, noise) in enumerate(zip(loop.channels, output_noise(model, model.rows(kind, loop.channels)))):
            step = step_response(loop, point, j)
            numbers[f"noise of {kind} {name} [{unit}]"] = noise
            numbers[f"settling {name} [s]"], numbers[f"overshoot {name}"] = step.settling, step.overshoot
    else:
        numbers = dict.fromkeys(numbers, np.nan)
    numbers["spectral radius"] = model.spectral_radius
    return Robustness(label, stable, frequency, loops, *sigma, disk, gains, {k: float(v) for k, v in numbers.items()})


def band(name: str, robots: Iterable[tuple[str, Robot]], at: Mapping[str, float] | str | None = None) -> Band:
    """Robustness of each labelled robot at an operating point; robots without one are failures."""
    return gather(name, ((label, robot, at) for label, robot in robots))


def points_band(robot: Robot) -> Band:
    """Robustness at each operating point that the machine names."""
    points = robot.machine.loop.points if robot.machine.loop else {}
    return gather("operating points", ((label, robot, label) for label in points))


def gather(name: str, members: Iterable[tuple[str, Robot, Mapping[str, float] | str | None]]) -> Band:
    """The band of labelled robots, each at an operating point."""
    found, failures = [], []
    for label, robot, at in members:
        try:
            found.append(robustness(*linearise_robot(robot, at), label))
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

    Args:
        robot: the improved robot of that diagnosis, or the nominal one.
        answer: the diagnosis as `exodrake diagnose --json` writes it.
        draws: number of robots.
        seed: of the draws; each parameter is normal on either side of its value, and inside its interval.
        ends: of the intervals, -1 lower, 0 the estimate, 1 upper, at which the first robots have all parameters.

    Raises:
        InputError: the answer has no effects, or names parameters that the robot lacks.
    """
    effects = answer.get("effects") if isinstance(answer, Mapping) else None
    if not isinstance(effects, list):
        raise InputError("the diagnosis holds no list of effects: not an answer of exodrake diagnose --json")
    if not effects:
        raise InputError("the diagnosis names no effect, so there are no intervals to draw from")
    for k in range(draws):
        drawn, end = robot, ends[k] if k < len(ends) else None
        draw = partial(draw_within, rng=np.random.default_rng([seed, k]), end=end)
        for effect in effects:
            try:
                stated = {n: i for n, i in effect["parameters"].items() if i["value"] is not None}
                values: dict[str, Any] = {n: draw(i) for n, i in stated.items()}
                values |= {n: {c: draw(i) for c, i in at.items()} for n, at in effect["channels"].items()}
                channels = [*effect["wires"], *effect["joints"]]
                drawn = drawn.splice(effect["id"], values, channels)
            except (KeyError, TypeError, AttributeError):
                raise InputError("the diagnosis states an effect without id, parameters and intervals") from None
        yield f"draw {k + 1}" if end is None else ("lower ends", "estimate", "upper ends")[int(end) + 1], drawn


def draw_within(interval: Mapping[str, Any], rng: np.random.Generator, end: float | None) -> float:
    """A value inside a 90 % interval, or at its end: tails could leave what a robot can be.

    Normal on either side of the estimate; an end that is not known stands at the estimate.
    """
    x = float(ndtri(rng.uniform(0.05, 0.95))) / NORMAL_90 if end is None else end
    value, other = interval["value"], interval["high" if x > 0.0 else "low"]
    return value if other is None else value + abs(x) * (other - value)
