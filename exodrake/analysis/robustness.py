"""Robustness of a loop with all its commands at once, and its bands over a population of robots or operating points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from exodrake.analysis.disk_margin import disk_margin
from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.linear_model import FrameModel, output_noise
from exodrake.analysis.margins import gain_margins, phase_margin
from exodrake.analysis.open_loop import OpenLoop, opened
from exodrake.analysis.operating_point import OperatingPoint, linearised
from exodrake.analysis.step_response import step_response
from exodrake.core.errors import InputError
from exodrake.core.robot import Robot

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


def grid(loop: OpenLoop) -> np.ndarray:
    """Frequencies (f,) [Hz], logarithmic to the Nyquist frequency."""
    return np.geomspace(SLOWEST, 1.0, POINTS) * 0.5 / loop.period


def relative_gains(plant: np.ndarray) -> np.ndarray:
    """Diagonal (f, channels) [-] of the relative gain array of a plant (f, channels, channels): 1 without coupling.

    Bristol's array G * inv(G)^T, with absolute values of the complex elements.
    """
    return np.abs(np.einsum("fii,fii->fi", plant, np.linalg.pinv(plant)))


def noise_of(model: FrameModel, kind: str) -> np.ndarray:
    """Standard deviation (channels,) [SI] of the outputs of a kind under the sensors' noise, in a stable loop."""
    rows = [i for i, name in enumerate(model.outputs) if name.rsplit("_", 1)[0] == kind]
    return output_noise(model.A, model.N, model.C[rows], model.M[rows])


def robustness(loop: FrameMap, point: OperatingPoint, model: FrameModel, label: str = "") -> Robustness:
    """Robustness of a loop at an operating point."""
    whole = opened(loop, model)
    frequency, eye = grid(whole), np.eye(len(loop.channels))
    s = np.linalg.inv(eye + whole.ratio(frequency))
    loops = 1.0 / np.einsum("fii->fi", s) - 1.0
    t, disk, stable = eye - s, disk_margin(s), model.spectral_radius < 1.0 if model.decides else None
    sigma = np.linalg.norm(s, 2, axis=(1, 2)), np.linalg.norm(t, 2, axis=(1, 2))
    gains = relative_gains(whole.plant(frequency))
    numbers = {"max sigma(S)": sigma[0].max(), "max sigma(T)": sigma[1].max(), "disk margin": disk.min()}
    for j, name in enumerate(loop.channels):
        margin, _, delay = phase_margin(frequency, loops[:, j])
        single = s[:, j : j + 1, j : j + 1]
        numbers[f"gain margin {name}"] = gain_margins(loops[:, j])[1]
        numbers[f"phase margin {name} [rad]"] = margin
        numbers[f"delay margin {name} [s]"] = delay
        numbers[f"disk margin {name}"] = disk_margin(single).min()
        numbers[f"relative gain {name}"] = gains[0, j]
    numbers |= closed_numbers(loop, point, model) if stable else {}
    if not stable:
        numbers = dict.fromkeys(numbers, np.nan)
    numbers["spectral radius"] = model.spectral_radius
    return Robustness(label, stable, frequency, loops, *sigma, disk, gains, {k: float(v) for k, v in numbers.items()})


def closed_numbers(loop: FrameMap, point: OperatingPoint, model: FrameModel) -> dict[str, float]:
    """Noise of the commands, and settling and overshoot of nonlinear steps, of a stable loop."""
    kind, unit = loop.column(loop.loop.command), loop.robot.machine.signal[loop.loop.command].unit
    numbers = {}
    for j, (name, noise) in enumerate(zip(loop.channels, noise_of(model, kind))):
        step = step_response(loop, point, j)
        numbers[f"noise of {kind} {name} [{unit}]"] = noise
        numbers[f"settling {name} [s]"], numbers[f"overshoot {name}"] = step.settling, step.overshoot
    return numbers


def band(name: str, robots: Iterable[tuple[str, Robot]], at: Mapping[str, float] | str | None = None) -> Band:
    """Robustness of each labelled robot at an operating point; robots without one are failures."""
    return gathered(name, ((label, robot, at) for label, robot in robots))


def points_band(robot: Robot) -> Band:
    """Robustness at each operating point that the machine names."""
    points = robot.machine.loop.points if robot.machine.loop else {}
    return gathered("operating points", ((label, robot, label) for label in points))


def gathered(name: str, members: Iterable[tuple[str, Robot, Mapping[str, float] | str | None]]) -> Band:
    """The band of labelled robots, each at an operating point."""
    found, failures = [], []
    for label, robot, at in members:
        try:
            found.append(robustness(*linearised(robot, at), label))
        except InputError as problem:
            failures.append(f"{label}: {problem}")
    return Band(name, tuple(found), tuple(failures))
