"""Stability maps: the spectral radius of the frame map over the gains, and over added command latency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.analysis.crossing import first_crossing
from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.linear_model import FRACTION, differences, excursions, spectral_radius, used
from exodrake.analysis.operating_point import OperatingPoint

GAINS = 31  # points along each gain
LATENCIES = np.arange(0.0, 8.01, 0.25)  # frames


@dataclass(frozen=True, eq=False)
class StabilityMap:
    """Spectral radius over two gains.

    Attributes:
        names: of the gains.
        first (m,), second (n,): their values [SI].
        radius: (n, m) [-].
        nominal: values of the robot.
        limit: (n,) first gain up to which the loop is stable at that second; nan beyond the map, 0 where none is.
    """

    names: tuple[str, str]
    first: np.ndarray
    second: np.ndarray
    radius: np.ndarray
    nominal: tuple[float, float]
    limit: np.ndarray


@dataclass(frozen=True, eq=False)
class LatencySweep:
    """Spectral radius (n,) over `frames` (n,) of command latency added on all channels; `limit` [frames] or nan."""

    frames: np.ndarray
    radius: np.ndarray
    limit: float


def stability_limit(x: np.ndarray, radius: np.ndarray) -> float:
    """Abscissa x (n,) [-] at which the radius (n,) first passes 1 upwards; 0 if never below 1, NaN if never above."""
    below = np.flatnonzero(radius < 1.0)
    return first_crossing(x[below[0] :], radius[below[0] :], 1.0) if len(below) else 0.0


def radius_at(loop: FrameMap, point: OperatingPoint, size: np.ndarray, keep: np.ndarray) -> float:
    """Spectral radius of the frame map where it rests, from the states `keep`; size: excursions (states,) [SI]."""
    central = differences(loop, point.state, point.references, size, FRACTION, keep).central
    return spectral_radius(central[np.ix_(keep, keep)])


def stability_map(
    loop: FrameMap, point: OperatingPoint, first: np.ndarray | None = None, second: np.ndarray | None = None
) -> StabilityMap:
    """The map over the loop's two gains, linearised afresh at each pair; the loop rests in the same state under all.

    Args:
        loop: the frame map.
        point: operating point.
        first: (m,) rising [SI]; a grid by default.
        second: (n,) rising [SI]; a grid by default.
    """
    across, up = loop.loop.gains
    names = (across.parameter, up.parameter)
    nominal = tuple(float(loop.parameters[loop.robot.indices(name)[0]]) for name in names)
    x = np.linspace(across.low, across.high, GAINS)[across.low == 0.0 :] if first is None else np.asarray(first, float)
    y = np.linspace(up.low, up.high, GAINS) if second is None else np.asarray(second, float)
    size = excursions(loop, point.state, point.references)
    largest = loop.with_values({names[0]: x.max(), names[1]: np.abs(y).max()})
    keep = used(largest, point.state, point.references, size)
    radius = np.array(
        [[radius_at(loop.with_values({names[0]: a, names[1]: b}), point, size, keep) for a in x] for b in y]
    )
    return StabilityMap(
        names, x, y, radius, (nominal[0], nominal[1]), np.array([stability_limit(x, row) for row in radius])
    )


def latency_sweep(loop: FrameMap, point: OperatingPoint, frames: np.ndarray = LATENCIES) -> LatencySweep | None:
    """Spectral radius over latency (n,) [frames] added to all commands; None where the loop names no such effect."""
    name = loop.loop.latency
    if not name:
        return None
    size = excursions(loop, point.state, point.references)
    own = loop.parameters[loop.robot.indices(name)[0]]
    late = [loop.with_values({name: own + f}) for f in frames]
    keeps = [used(one, point.state, point.references, size) for one in late]
    radius = np.array([radius_at(one, point, size, keep) for one, keep in zip(late, keeps)])
    return LatencySweep(np.asarray(frames, dtype=float), radius, stability_limit(frames, radius))
