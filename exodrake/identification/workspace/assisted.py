"""Postures in static equilibrium with the wires (A.M.), over the box of tensions.

Friction is left out: the tension at the finger equals that of the wire. The wires couple the joints, so the region is
the image of the box of tensions, and smaller than the ranges of the joints alone would give.
"""

from typing import NamedTuple

import numpy as np

from exodrake.core.errors import InputError
from exodrake.identification.workspace.area import hulls
from exodrake.identification.workspace.chain import DISTAL, FINGERTIP, Ranges, tip


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
        import shapely

        mcp, pip, dip = np.moveaxis(self.angles, -1, 0)
        ends = [tip(lengths, mcp, pip, dip, along) for along in ((None, 0.0) if what == DISTAL else (None,))]
        cells = [_cells(np.moveaxis(np.stack(ends, axis=3), wire, 2)) for wire in range(3)]
        return shapely.union_all(hulls(np.concatenate(cells)))


def assisted(robot, steps: int = 25) -> Assisted:
    """Solve the statics of a robot over `steps` tensions per wire, between its limits F_min and F_max.

    Raises:
        InputError: For fewer than 3 steps, or naming a tension without equilibrium.
    """
    from exodrake.physics.finger_statics import parameters_of, posture

    if steps < 3:
        raise InputError(f"workspace: {steps} tensions per tendon are too few; at least 3")
    wires = [
        np.linspace(robot.limits["F_min"][wire], robot.limits["F_max"][wire], steps) for wire in ("AF", "MF", "AE")
    ]
    grid = np.stack(np.meshgrid(*wires, indexing="ij"), axis=-1)
    angles = posture(grid.reshape(-1, 3), parameters_of(robot)).reshape(grid.shape)
    if np.isnan(angles).any():
        where = np.argwhere(np.isnan(angles).any(axis=-1))[0]
        af, mf, ae = grid[tuple(where)]
        raise InputError(
            f"{robot.source}: no equilibrium with AF {af:g}, MF {mf:g}, AE {ae:g} N; lower the limits F_max"
        )
    return Assisted(grid, angles)


def _cells(points: np.ndarray) -> np.ndarray:
    """Corners (cells, 4 k, 2) [m] of the cells along the first two axes of points (n, n, n, k, 2) [m]."""
    corners = [points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]]
    return np.stack(corners, axis=3).reshape(-1, 4 * points.shape[3], 2)
