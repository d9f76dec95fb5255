"""Workspaces of the fingertip and the distal phalanx (paper Table 2, Fig. 13).

Planar chain of three phalanges, origin in the MCP, x along the proximal phalanx at MCP zero, y palmar; exact areas as
unions of polygons, checked by random points, and those that the wires reach: `docs/explain/identification.md`.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from matplotlib.figure import Figure

from exodrake.core.errors import InputError
from exodrake.data.plot import new_figure

FINGERTIP, DISTAL = "fingertip", "distal phalanx"
ARC = 0.01  # rad; finest step along arcs and curves
SIMPLER = 2e-5  # m, outlines are drawn this exactly
HEAD = ("motion", "workspace", "exact [mm2]", "Monte Carlo [mm2]", "standard error [mm2]", "points")


class Ranges(NamedTuple):
    """Smallest and largest flexion of each joint [rad]."""

    MCP: tuple[float, float]
    PIP: tuple[float, float]
    DIP: tuple[float, float]


LENGTHS = (0.04264, 0.02014, 0.01872)  # m, phalanges (paper Table 1)
SPONTANEOUS = Ranges((-0.35, 1.34), (0.08, 1.56), (0.07, 0.92))  # rad, spontaneous motion (paper Table 2)


def tip(lengths, mcp, pip, dip, along=None) -> np.ndarray:
    """Positions (..., 2) [m] of a point of the distal phalanx at angles (...) [rad].

    It lies at a distance `along` (...) [m] from the DIP, at the end if None, on phalanges of lengths (3,) [m].
    """
    first = np.asarray(mcp, dtype=float)
    angles = (first, first + pip, first + pip + dip)
    bones = (lengths[0], lengths[1], lengths[2] if along is None else along)
    point = sum(bone * np.exp(1j * angle) for bone, angle in zip(bones, angles))
    return np.stack([np.real(point), np.imag(point)], axis=-1)


def reachable(points: np.ndarray, lengths, ranges: Ranges, dip: float, along: float) -> np.ndarray:
    """Mask (n,) of the points (n, 2) [m] that a point of the distal phalanx can reach at one DIP angle [rad].

    The chain beyond the PIP acts as one link of length |e| and angle arg e; the law of cosines gives the PIP (two
    solutions) and the MCP. The point lies at a distance `along` [m] from the DIP.
    """
    beyond = lengths[1] + along * np.exp(1j * dip)
    wanted = points[:, 0] + 1j * points[:, 1]
    bone = abs(beyond)
    cosine = (np.abs(wanted) ** 2 - lengths[0] ** 2 - bone**2) / (2 * lengths[0] * bone)
    bend = np.arccos(np.clip(cosine, -1, 1))
    inside = np.zeros(len(points), dtype=bool)
    for turn in (bend, -bend):
        pip = turn - np.angle(beyond)
        mcp = np.angle(wanted) - np.angle(lengths[0] + bone * np.exp(1j * turn))
        mcp = ranges.MCP[0] + np.mod(mcp - ranges.MCP[0], 2 * np.pi)
        inside |= (pip >= ranges.PIP[0]) & (pip <= ranges.PIP[1]) & (mcp <= ranges.MCP[1])
    return inside & (np.abs(cosine) <= 1)


def check(lengths, ranges: Ranges) -> None:
    """Raise InputError for a phalanx without length or a range with ends in the wrong order."""
    for joint, length, (low, high) in zip(Ranges._fields, lengths, ranges, strict=True):
        if not length > 0:
            raise InputError(f"workspace: phalanx distal to {joint} has length {length} m")
        if not -np.pi < low < high < np.pi:
            raise InputError(f"workspace: range of {joint}, {low} .. {high} rad, does not rise within -pi .. pi")


def reach(lengths, ranges: Ranges, what: str = FINGERTIP, steps: int = 60):
    """Region that the fingertip or the whole distal phalanx reaches, a shapely geometry in m.

    From lengths (3,) [m] and ranges of motion, with `steps` of each joint between its limits. InputError if impossible.
    """
    check(lengths, ranges)
    pip, dip = np.linspace(*ranges.PIP, steps), np.linspace(*ranges.DIP, steps)
    fine_mcp, fine_pip, fine_dip = (np.linspace(low, high, 2 + int((high - low) / ARC)) for low, high in ranges)
    curves = [tip(lengths, 0.0, q, fine_dip) for q in pip] + [tip(lengths, 0.0, fine_pip, q) for q in dip]
    if what == DISTAL:
        bone = np.linspace(0, lengths[2], 12)
        every = max(1, steps // 30)
        curves += [tip(lengths, 0.0, q2, q3, bone) for q2 in pip[::every] for q3 in dip[::every]]
        curves += [tip(lengths, 0.0, q2, q3, bone) for q2 in pip for q3 in ranges.DIP]
        curves += [tip(lengths, 0.0, q2, q3, bone) for q2 in ranges.PIP for q3 in dip]
        curves += [tip(lengths, 0.0, fine_pip, ranges.DIP[0], 0.0)]
    turn, patches = np.exp(1j * fine_mcp), []
    for curve in curves:  # polygons that it sweeps as the MCP rotates, one for each part of monotonic distance
        place = curve[:, 0] + 1j * curve[:, 1]
        way = np.sign(np.diff(np.abs(place)))
        cuts = np.r_[0, np.flatnonzero(way[1:] * way[:-1] < 0) + 1, len(curve) - 1]
        for start, stop in pairwise(cuts.tolist()):
            part = place[start : stop + 1]
            ring = np.concatenate([part * turn[0], part[-1] * turn, part[::-1] * turn[-1], part[0] * turn[::-1]])
            patches.append(shapely.polygons(np.stack([np.real(ring), np.imag(ring)], axis=1)))
    # chords of thin patches may cross by less than a micrometre
    return shapely.union_all(shapely.make_valid(np.array(patches)))


def monte_carlo(
    lengths, ranges: Ranges, what: str = FINGERTIP, samples: int = 40_000, seed: int = 0
) -> tuple[float, float]:
    """Estimate the area of `reach` and its standard error [m2] by random points. InputError for what is impossible."""
    check(lengths, ranges)
    # bounding box of a grid of postures, with a margin for postures between
    q = np.meshgrid(*(np.linspace(*span, 61) for span in ranges), indexing="ij")
    grid = tip(lengths, *q).reshape(-1, 2)
    if what == DISTAL:
        grid = np.concatenate([grid, tip(lengths, q[0], q[1], 0.0, 0.0).reshape(-1, 2)])
    margin = 1e-3 * np.sum(lengths)
    low, high = grid.min(axis=0) - margin, grid.max(axis=0) + margin
    outside = np.random.default_rng(seed).uniform(low, high, (samples, 2))
    bones = [lengths[2]] if what == FINGERTIP else np.linspace(lengths[2], 0, 16)
    for dip in np.linspace(*ranges.DIP, 40 if what == FINGERTIP else 24):
        for along in bones:
            outside = outside[~reachable(outside, lengths, ranges, dip, along)]
    share, box = 1 - len(outside) / samples, float(np.prod(high - low))
    return box * share, box * float(np.sqrt(share * (1 - share) / samples))


class Assisted(NamedTuple):
    """Tensions (n, n, n, 3) [N] of AF, MF, AE and the angles (n, n, n, 3) [rad] of MCP, PIP, DIP."""

    tensions: np.ndarray
    angles: np.ndarray

    @property
    def ranges(self) -> Ranges:
        """Smallest and largest angle of each joint over all tensions [rad]."""
        mcp, pip, dip = ((float(q.min()), float(q.max())) for q in np.moveaxis(self.angles, -1, 0))
        return Ranges(mcp, pip, dip)

    def region(self, lengths, what: str = FINGERTIP):
        """Region of all tensions, a shapely geometry in m, for phalanx lengths (3,) [m]."""
        mcp, pip, dip = np.moveaxis(self.angles, -1, 0)
        ends = [tip(lengths, mcp, pip, dip, along) for along in ((None, 0.0) if what == DISTAL else (None,))]
        cells = []
        for wire in range(3):  # hulls of the cells along the two other axes
            p = np.moveaxis(np.stack(ends, axis=3), wire, 2)
            sides = np.stack([p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]], axis=3)
            cells.append(sides.reshape(-1, 4 * len(ends), 2))
        return shapely.union_all(shapely.convex_hull(shapely.linestrings(np.concatenate(cells))))


def solve_assisted(robot, steps: int = 25) -> Assisted:
    """Solve the statics of a robot over `steps` tensions per wire, two or more, between its limits F_min and F_max.

    InputError naming a tension without equilibrium.
    """
    from exodrake.physics.finger_statics import posture, read_parameters  # compiles

    low, high = robot.limits["F_min"], robot.limits["F_max"]
    tensions = [np.linspace(low[wire], high[wire], steps) for wire in ("AF", "MF", "AE")]
    grid = np.stack(np.meshgrid(*tensions, indexing="ij"), axis=-1)
    angles = posture(grid.reshape(-1, 3), read_parameters(robot)).reshape(grid.shape)
    if len(lost := np.argwhere(np.isnan(angles).any(axis=-1))):
        at = "AF {:g}, MF {:g}, AE {:g} N".format(*grid[tuple(lost[0])])
        raise InputError(f"{robot.source}: no equilibrium with {at}; lower the limits F_max")
    return Assisted(grid, angles)


def areas(lengths, ranges: Ranges, assisted: Assisted, samples: int, seed: int) -> list[tuple[str, ...]]:
    """Rows under HEAD: areas of the full range of motion (K.M.), then of the assisted motion (A.M.)."""
    rows = []
    for what in (FINGERTIP, DISTAL):
        exact, drawn = reach(lengths, ranges, what).area, monte_carlo(lengths, ranges, what, samples, seed)
        rows.append(("K.M.", what, f"{1e6 * exact:.1f}", *(f"{1e6 * x:.0f}" for x in drawn), str(samples)))
    for what in (FINGERTIP, DISTAL):
        rows.append(("A.M.", what, f"{1e6 * assisted.region(lengths, what).area:.1f}", "", "", ""))
    return rows


def workspace_figure(lengths, ranges: Ranges, assisted: Assisted) -> Figure:
    """Draw both workspaces, and the finger to scale, for phalanx lengths (3,) [m]."""
    figure = new_figure(9.6, 5.0)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    q, cut = [float(np.mean(span)) for span in ranges], np.tril(np.tile(lengths, (4, 1)), -1)
    for axes, what in zip(panels, (FINGERTIP, DISTAL), strict=True):
        regions = reach(lengths, ranges, what), assisted.region(lengths, what)
        looks = ("#98a2b3", "full range of motion"), ("#c8372d", "assisted by the tendons")
        for region, (colour, name) in zip(regions, looks):
            label = f"{name}, {1e6 * region.area:.0f} mm²"
            for piece in getattr(outline := region.simplify(SIMPLER), "geoms", [outline]):
                x, y = 1e3 * np.array(piece.exterior.coords).T
                axes.fill(x, y, fc=(colour, 0.4), ec=colour, lw=1.0, label=label)
                label = None
        x, y = 1e3 * np.array([tip(bones, *q) for bones in cut]).T
        axes.plot(x, y, "-o", color="#1f4f7a", lw=2.4, ms=4.5, mfc="white", label="finger, mid range")
        axes.set(title=f"{what} workspace", xlabel="x, along the proximal phalanx at MCP 0 [mm]", aspect="equal")
        axes.legend(loc="upper left", fontsize=8)
    panels[0].set(ylabel="y, palmar [mm]", ylim=(92, -55))  # palmar down, as the hand lies
    return figure
