"""Candidate controllers on a linear plant, which is linearised once: no controller needs a simulation.

    plant        x' = A x + B v           y = Y x
    controller   q' = F q + G y + H r     v = K q + L y + M r

The controller's matrices are differences of the same compiled frame map, with its own states, the references and the
readings moved. Any law of the machine's controller can therefore be tuned.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from exodrake.analysis.disk_margin import structured_bound
from exodrake.analysis.frame_map import FrameMap, state_names
from exodrake.analysis.linear_model import FrameModel, excursions, matters, output_noise, spectral_radius
from exodrake.analysis.open_loop import OpenLoop, opened
from exodrake.analysis.operating_point import OperatingPoint, linearised
from exodrake.analysis.step_response import BAND
from exodrake.core.robot import Robot

FREQUENCIES, FRAMES = 120, 300  # of the disk margin; of a step


@dataclass(frozen=True, eq=False)
class Plant:
    """A robot's plant at an operating point, linear.

    Attributes:
        loop, point: frame map and state of rest.
        model: closed loop with the robot's own controller.
        A (n, n), B (n, channels), Y (channels, n), N (n, noises), E (channels, noises): y = Y x + E e.
        frequency (f,) [Hz], response (f, channels, channels): of the readings to the commands.
        moved: (channels,) places in the full state that move one reading each, by size (channels,).
    """

    loop: FrameMap
    point: OperatingPoint
    model: FrameModel
    A: np.ndarray
    B: np.ndarray
    Y: np.ndarray
    N: np.ndarray
    E: np.ndarray
    frequency: np.ndarray
    response: np.ndarray
    moved: np.ndarray
    size: np.ndarray


def plant_of(robot: Robot, at: Mapping[str, float] | str | None = None) -> Plant:
    """The linear plant of a robot at an operating point. InputError without loop or state of rest."""
    loop, point, model = linearised(robot, at)
    whole = opened(loop, model)
    frequency = np.geomspace(4e-4, 1.0, FREQUENCIES) * 0.5 / whole.period
    rest = ~whole.controller
    rows = [model.outputs.index(f"{loop.column(loop.loop.measured)}_{c}") for c in loop.channels]
    sent = [model.outputs.index(f"{loop.column(loop.loop.command)}_{c}") for c in loop.channels]
    noise = model.N[rest] - whole.B[rest] @ model.M[sent]  # without what comes by the robot's own controller
    moved, size = reading_states(loop, point, whole)
    return Plant(
        loop, point, model, whole.A[np.ix_(rest, rest)], whole.B[rest], whole.Y[:, rest], noise, model.M[rows],
        frequency, whole.plant(frequency), moved, size,
    )  # fmt: skip


def reading_states(loop: FrameMap, point: OperatingPoint, whole: OpenLoop) -> tuple[np.ndarray, np.ndarray]:
    """Indices (channels,) of the states that move a reading most each, and how far to move them (channels,) [SI]."""
    names = [name.name for name in state_names(loop.robot.machine)]
    size = excursions(loop, point.state, point.references)
    places = np.array([names.index(name) for name in whole.states])
    weight = np.where(whole.controller, 0.0, np.abs(whole.Y) * size[places])
    chosen = places[weight.argmax(axis=1)]
    return chosen, 0.05 * size[chosen]


@dataclass(frozen=True, eq=False)
class Law:
    """Matrices of a linear controller (see the module): F (q, q), G (q, m), H (q, m), K (m, q), L (m, m), M (m, m)."""

    F: np.ndarray
    G: np.ndarray
    H: np.ndarray
    K: np.ndarray
    L: np.ndarray
    M: np.ndarray


def law_of(plant: Plant, values: Mapping[str, Any]) -> Law:
    """The linear law of the plant's own controller with other parameters [SI], one or one for each channel."""
    loop, point = plant.loop.with_values(values), plant.point
    step, m = loop.stepper(), len(loop.channels)
    own = np.flatnonzero(loop.own)
    command, reading = loop.signals[loop.loop.command], loop.signals[loop.loop.measured]

    def image(x: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        after, signals = step(x, r)
        return np.append(after[own], signals[command]), signals[reading]

    rest, y = image(point.state, point.references)
    q, nudge = len(own), 1e-3 * loop.loop.step
    inner, outer, read = np.zeros((q + m, q)), np.zeros((q + m, m)), np.zeros((q + m, m))
    change = np.zeros((m, m))
    for i, place in enumerate(own):
        x = point.state.copy()
        x[place] += nudge
        inner[:, i] = (image(x, point.references)[0] - rest) / nudge
    for j in range(m):
        r, x = point.references.copy(), point.state.copy()
        r[j] += nudge
        outer[:, j] = (image(point.state, r)[0] - rest) / nudge
        x[plant.moved[j]] += plant.size[j]
        moved, seen = image(x, point.references)
        read[:, j], change[:, j] = moved - rest, seen - y
    read = read @ np.linalg.inv(change)
    keep = matters(inner[:q], inner[q:])
    return Law(inner[np.ix_(keep, keep)], read[keep], outer[keep], inner[q:][:, keep], read[q:], outer[q:])


@dataclass(frozen=True)
class Performance:
    """Performance of a controller on one linear plant; the worst over channels.

    Attributes:
        radius: spectral radius.
        settling: to 2 % [s], beyond the horizon by what is missing.
        overshoot: fraction.
        disk_margin: of all commands at once, never overstated.
        noise: largest standard deviation of a command [SI].
    """

    radius: float
    settling: float
    overshoot: float
    disk_margin: float
    noise: float


UNSTABLE = (np.inf, np.inf, 0.0, np.inf)


def performance(plant: Plant, values: Mapping[str, Any]) -> Performance:
    """Performance of the controller with these values [SI]."""
    law = law_of(plant, values)
    a, b = closed(plant, law)
    radius = spectral_radius(a)
    if radius >= 1.0:
        return Performance(radius, *UNSTABLE)
    settling, overshoot = step_performance(plant, a, b)
    return Performance(radius, settling, overshoot, disk_of(plant, law), float(noise_of(plant, law, a).max()))


def closed(plant: Plant, law: Law) -> tuple[np.ndarray, np.ndarray]:
    """A (n, n) and B (n, channels) [SI] of the loop closed by a law, the plant's states first."""
    a = np.block([[plant.A + plant.B @ law.L @ plant.Y, plant.B @ law.K], [law.G @ plant.Y, law.F]])
    return a, np.vstack([plant.B @ law.M, law.H])


def step_performance(plant: Plant, a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Settling [s] and overshoot [-] of x' = A x + B r, a (n, n), b (n, channels), the worst over the references."""
    n, m = plant.A.shape[0], b.shape[1]
    x, share = np.zeros((len(a), m)), np.zeros((FRAMES, m))
    for k in range(FRAMES):
        x = a @ x + b
        share[k] = np.diag(plant.Y @ x[:n])
    outside = np.abs(share - 1.0) > BAND
    last = np.where(outside.any(axis=0), FRAMES - 1 - outside[::-1].argmax(axis=0), -1)
    missing = np.maximum(np.abs(share[-1] - 1.0) - BAND, 0.0)
    settling = plant.loop.robot.machine.frame * (last + 2 + FRAMES * missing)
    return float(settling.max()), max(0.0, float(share.max()) - 1.0)


def disk_of(plant: Plant, law: Law) -> float:
    """Disk margin of all commands at once on the plant's grid."""
    z = np.exp(2j * np.pi * plant.frequency * plant.loop.robot.machine.frame)
    inner = np.linalg.solve(z[:, None, None] * np.eye(len(law.F)) - law.F, law.G[None].astype(complex))
    ratio = -(law.K @ inner + law.L) @ plant.response
    eye = np.eye(len(law.L))
    return float(1.0 / structured_bound(np.linalg.inv(eye + ratio) - 0.5 * eye)[0].max())


def noise_of(plant: Plant, law: Law, a: np.ndarray) -> np.ndarray:
    """Standard deviation (channels,) of the commands [SI] under the sensors' noise."""
    drive = np.vstack([plant.N + plant.B @ law.L @ plant.E, law.G @ plant.E])
    return output_noise(a, drive, np.hstack([law.L @ plant.Y, law.K]), law.L @ plant.E)
