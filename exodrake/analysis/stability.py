"""Stability maps: the spectral radius of the frame map over the gains, and over added command latency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.linear import FRACTION, differences, excursions, spectral_radius, used
from exodrake.analysis.operating import OperatingPoint

KP, KD = "controller.kp", "controller.kd"
LATENCY = "timing.command_latency.frames"
GAINS = 31  # points along each gain
LATENCIES = np.arange(0.0, 8.01, 0.25)  # frames
KP_TOP, KD_LOW, KD_TOP = 0.03, -5e-4, 5e-4  # reach of the map [m/(s N)], [m/N]


@dataclass(frozen=True, eq=False)
class StabilityMap:
    """Spectral radius over the gains.

    Attributes:
        kp (m,) [m/(s N)], kd (n,) [m/N], radius (n, m) [-]; nominal: (kp, kd) of the robot.
        limit: (n,) kp [m/(s N)] up to which the loop is stable at that kd; nan beyond the map's edge, 0 where none is.
    """

    kp: np.ndarray
    kd: np.ndarray
    radius: np.ndarray
    nominal: tuple[float, float]
    limit: np.ndarray


@dataclass(frozen=True, eq=False)
class LatencySweep:
    """Spectral radius (n,) over `frames` (n,) of command latency added on all tendons; `limit` [frames] or nan."""

    frames: np.ndarray
    radius: np.ndarray
    limit: float


def first_crossing(x: np.ndarray, radius: np.ndarray) -> float:
    """Where the radius first passes 1 upwards, by a straight line; 0 if never below 1, nan if never above."""
    below = np.flatnonzero(radius < 1.0)
    if not len(below):
        return 0.0
    above = np.flatnonzero((radius >= 1.0) & (np.arange(len(x)) > below[0]))
    if not len(above):
        return float("nan")
    k = above[0]
    return float(x[k - 1] + (x[k] - x[k - 1]) * (1.0 - radius[k - 1]) / (radius[k] - radius[k - 1]))


def radius_at(loop: FrameMap, point: OperatingPoint, size: np.ndarray, keep: np.ndarray) -> float:
    """Spectral radius of the frame map at an operating point, from the states `keep`; size: excursions (states,)."""
    central = differences(loop, point.state, point.references, size, FRACTION, keep).central
    return spectral_radius(central[np.ix_(keep, keep)])


def stability_map(
    loop: FrameMap, point: OperatingPoint, kp: np.ndarray | None = None, kd: np.ndarray | None = None
) -> StabilityMap:
    """The map over kp and kd, linearised afresh at each pair; the loop rests in the same state under all gains.

    Args:
        loop: the frame map.
        point: operating point.
        kp: (m,) rising [m/(s N)]; a grid by default.
        kd: (n,) rising [m/N]; a grid by default. A kd below 0 is the printed sign.
    """
    nominal = (float(loop.parameters[loop.robot.indices(KP)[0]]), float(loop.parameters[loop.robot.indices(KD)[0]]))
    kp = np.linspace(0.0, KP_TOP, GAINS)[1:] if kp is None else np.asarray(kp, dtype=float)
    kd = np.linspace(KD_LOW, KD_TOP, GAINS) if kd is None else np.asarray(kd, dtype=float)
    size = excursions(loop, point.state, point.references)
    largest = loop.with_values({KP: kp.max(), KD: np.abs(kd).max()})
    keep = used(largest, point.state, point.references, size)
    radius = np.array([[radius_at(loop.with_values({KP: p, KD: d}), point, size, keep) for p in kp] for d in kd])
    return StabilityMap(kp, kd, radius, nominal, np.array([first_crossing(kp, row) for row in radius]))


def latency_sweep(loop: FrameMap, point: OperatingPoint, frames: np.ndarray = LATENCIES) -> LatencySweep | None:
    """Spectral radius over added command latency on all tendons [frames]; None where the robot knows no such effect."""
    if not any(name.startswith(LATENCY) for name in loop.robot.machine.index):
        return None
    size = excursions(loop, point.state, point.references)
    own = loop.parameters[loop.robot.indices(LATENCY)[0]]
    late = [loop.with_values({LATENCY: own + f}) for f in frames]
    keeps = [used(one, point.state, point.references, size) for one in late]
    radius = np.array([radius_at(one, point, size, keep) for one, keep in zip(late, keeps)])
    return LatencySweep(np.asarray(frames, dtype=float), radius, first_crossing(frames, radius))
