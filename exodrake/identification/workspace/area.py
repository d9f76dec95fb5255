"""Area of a workspace: as a union of polygons, and by Monte Carlo with its standard error.

Union: a curve of postures at one MCP angle, whose distance from the MCP is monotonic, sweeps a region bounded by two
copies of the curve and two arcs as the MCP rotates; other curves are cut where the distance turns. The curves run along
each joint with the others constant, at their limits and between, so they include the edges of the region. A refinement
of the steps changes the area by less than 0.1 %.

Monte Carlo: inverse kinematics (`chain.reachable`) decides for uniform points in the bounding box whether a posture
reaches them. Standard error: box sqrt(f (1 - f) / N).
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from exodrake.identification.workspace.chain import DISTAL, FINGERTIP, Ranges, check, reachable, tip

ARC = 0.01  # rad; finest step along arcs and curves


class Area(NamedTuple):
    """Area [m2], its standard error [m2], number of points, and area of the bounding box [m2]."""

    value: float
    error: float
    samples: int
    box: float


def reach(lengths, ranges: Ranges, what: str = FINGERTIP, steps: int = 60):
    """Region that the fingertip or the whole distal phalanx reaches, a shapely geometry in m.

    Args:
        lengths: (3,) phalanx lengths [m].
        ranges: Ranges of motion.
        what: FINGERTIP or DISTAL.
        steps: Steps of each joint between its limits.

    Raises:
        InputError: For impossible lengths or ranges.
    """
    import shapely

    check(lengths, ranges)
    pip, dip = np.linspace(*ranges.PIP, steps), np.linspace(*ranges.DIP, steps)
    fine_pip, fine_dip = _fine(ranges.PIP), _fine(ranges.DIP)
    curves = [tip(lengths, 0.0, q, fine_dip) for q in pip] + [tip(lengths, 0.0, fine_pip, q) for q in dip]
    if what == DISTAL:
        bone = np.linspace(0, lengths[2], 12)
        every = max(1, steps // 30)
        curves += [tip(lengths, 0.0, q2, q3, bone) for q2 in pip[::every] for q3 in dip[::every]]
        curves += [tip(lengths, 0.0, q2, q3, bone) for q2 in pip for q3 in ranges.DIP]
        curves += [tip(lengths, 0.0, q2, q3, bone) for q2 in ranges.PIP for q3 in dip]
        curves += [tip(lengths, 0.0, fine_pip, ranges.DIP[0], 0.0)]
    patches = np.array([patch for curve in curves for patch in _swept(curve, ranges.MCP)])
    return shapely.union_all(shapely.make_valid(patches))  # chords of thin patches may cross by less than a micrometre


def monte_carlo(lengths, ranges: Ranges, what: str = FINGERTIP, samples: int = 40_000, seed: int = 0) -> Area:
    """Estimate the area by random points in the bounding box.

    Args:
        lengths: (3,) phalanx lengths [m].
        ranges: Ranges of motion.
        what: FINGERTIP or DISTAL.
        samples: Number of points.
        seed: Of the random numbers.

    Raises:
        InputError: For impossible lengths or ranges, or fewer than 100 samples.
    """
    from exodrake.core.errors import InputError

    check(lengths, ranges)
    if samples < 100:
        raise InputError(f"workspace: {samples} samples are too few; at least 100")
    low, high = _box(lengths, ranges, what)
    points = np.random.default_rng(seed).uniform(low, high, (samples, 2))
    outside = points
    bones = [lengths[2]] if what == FINGERTIP else np.linspace(lengths[2], 0, 16)
    for dip in np.linspace(*ranges.DIP, 40 if what == FINGERTIP else 24):
        for along in bones:
            outside = outside[~reachable(outside, lengths, ranges, dip, along)]
    share, box = 1 - len(outside) / samples, float(np.prod(high - low))
    return Area(box * share, box * float(np.sqrt(share * (1 - share) / samples)), samples, box)


def traced(lengths, angles: np.ndarray):
    """Region that the distal phalanx swept in a recorded motion, a shapely geometry in m.

    Args:
        lengths: (3,) phalanx lengths [m].
        angles: (frames, 3) angles of MCP, PIP, DIP [rad]; rows with NaN interrupt the path.
    """
    import shapely

    q = np.asarray(angles, dtype=float).T
    ends = np.stack([tip(lengths, q[0], q[1], q[2], along) for along in (0.0, None)], axis=1)
    pairs = np.concatenate([ends[:-1], ends[1:]], axis=1)
    pairs = pairs[np.isfinite(pairs).all(axis=(1, 2))]
    return shapely.union_all(hulls(pairs))


def _fine(span: tuple[float, float]) -> np.ndarray:
    return np.linspace(*span, 2 + int((span[1] - span[0]) / ARC))


def _swept(curve: np.ndarray, span: tuple[float, float]) -> list:
    """Polygons that a curve (n, 2) sweeps as the MCP rotates through `span`, one per monotonic part."""
    import shapely

    place = curve[:, 0] + 1j * curve[:, 1]
    radius = np.abs(place)
    way = np.sign(np.diff(radius))
    cuts = np.r_[0, np.flatnonzero(way[1:] * way[:-1] < 0) + 1, len(curve) - 1]
    turn = np.exp(1j * _fine(span))
    patches = []
    for start, stop in pairwise(cuts.tolist()):
        part = place[start : stop + 1]
        ring = np.concatenate([part * turn[0], part[-1] * turn, part[::-1] * turn[-1], part[0] * turn[::-1]])
        patches.append(shapely.polygons(np.stack([np.real(ring), np.imag(ring)], axis=1)))
    return patches


def _box(lengths, ranges: Ranges, what: str) -> tuple[np.ndarray, np.ndarray]:
    """Corners (2,) [m] of the bounding box of a grid of postures, with a margin for postures between."""
    q = np.meshgrid(*(np.linspace(*span, 61) for span in ranges), indexing="ij")
    points = tip(lengths, *q).reshape(-1, 2)
    if what == DISTAL:
        points = np.concatenate([points, tip(lengths, q[0], q[1], 0.0, 0.0).reshape(-1, 2)])
    margin = 1e-3 * np.sum(lengths)
    return points.min(axis=0) - margin, points.max(axis=0) + margin


def hulls(points: np.ndarray):
    """Convex hulls of point sets (n, k, 2) [m]."""
    import shapely

    return shapely.convex_hull(shapely.linestrings(points))
