"""Postures the wires can hold (A.M.): the nominal finger's statics (`identification.statics`) over the box of tensions.

Friction is left out: the tension at the finger is that of the wire. The joints move together as the wires make them, so
the region is the image of the box of tensions, smaller than what the joints' ranges alone would give.
"""

from typing import Any, NamedTuple

import numpy as np

from exodrake.core.errors import InputError
from exodrake.identification.workspace.area import hulls
from exodrake.identification.workspace.chain import DISTAL, FINGERTIP, Ranges, tip


class Assisted(NamedTuple):
    """tensions (n, n, n, 3) [N] of AF, MF, AE; angles (n, n, n, 3) [rad] of MCP, PIP, DIP."""

    tensions: np.ndarray
    angles: np.ndarray

    @property
    def ranges(self) -> Ranges:
        """Smallest and largest angle of each joint over all tensions [rad]."""
        mcp, pip, dip = ((float(q.min()), float(q.max())) for q in np.moveaxis(self.angles, -1, 0))
        return Ranges(mcp, pip, dip)

    def region(self, lengths, what: str = FINGERTIP):
        """What fingertip or distal phalanx reach over all tensions: a shapely geometry in m. lengths (3,) [m]."""
        import shapely

        mcp, pip, dip = np.moveaxis(self.angles, -1, 0)
        ends = [tip(lengths, mcp, pip, dip, along) for along in ((None, 0.0) if what == DISTAL else (None,))]
        cells = [_cells(np.moveaxis(np.stack(ends, axis=3), wire, 2)) for wire in range(3)]
        return shapely.union_all(hulls(np.concatenate(cells)))


def assisted(robot, steps: int = 25) -> Assisted:
    """Postures of a robot (`load_robot`) over `steps` tensions per wire, between its limits F_min and F_max.

    Errors: InputError for fewer than 3 steps, or naming a tension under which a joint finds no balance.
    """
    from exodrake.core.part import fields_of
    from exodrake.systems.finger_statics import posture
    from exodrake.systems.tendon_finger import Parameters

    if steps < 3:
        raise InputError(f"workspace: {steps} tensions per wire are too few; at least 3")
    values = [robot.channels(f"{field.group}.{field.name}") for field in fields_of(Parameters, "finger")]
    parameters = Parameters(*[_plain(v) for v in values])
    wires = [
        np.linspace(robot.limits["F_min"][wire], robot.limits["F_max"][wire], steps) for wire in ("AF", "MF", "AE")
    ]
    grid = np.stack(np.meshgrid(*wires, indexing="ij"), axis=-1)
    angles = posture(grid.reshape(-1, 3), parameters).reshape(grid.shape)
    if np.isnan(angles).any():
        where = np.argwhere(np.isnan(angles).any(axis=-1))[0]
        af, mf, ae = grid[tuple(where)]
        raise InputError(
            f"{robot.source}: no posture balances AF {af:g}, MF {mf:g}, AE {ae:g} N; lower the limits F_max"
        )
    return Assisted(grid, angles)


def _plain(values: np.ndarray) -> Any:
    """A number, or a tuple of one per channel, as the compiled functions take them."""
    return tuple(values.tolist()) if len(values) > 1 else float(values[0])


def _cells(points: np.ndarray) -> np.ndarray:
    """Corners (cells, 4 k, 2) of the cells spanned by the first two axes of points (n, n, n, k, 2)."""
    corners = [points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]]
    return np.stack(corners, axis=3).reshape(-1, 4 * points.shape[3], 2)
