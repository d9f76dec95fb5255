"""Forward and inverse kinematics of a planar chain of three phalanges.

Origin in the MCP, x along the proximal phalanx at MCP zero, y palmar (paper Fig. 13). With phi_i = q_1 + .. + q_i

    point at s along the distal phalanx = sum of L_i (cos phi_i, sin phi_i), the last with s in place of L_3
"""

from typing import NamedTuple

import numpy as np

FINGERTIP = "fingertip"
DISTAL = "distal phalanx"


class Ranges(NamedTuple):
    """Smallest and largest flexion of each joint [rad]."""

    MCP: tuple[float, float]
    PIP: tuple[float, float]
    DIP: tuple[float, float]


LENGTHS = (0.04264, 0.02014, 0.01872)  # m, phalanges (paper Table 1)
SPONTANEOUS = Ranges((-0.35, 1.34), (0.08, 1.56), (0.07, 0.92))  # rad, spontaneous motion (paper Table 2)


def tip(lengths, mcp, pip, dip, along=None) -> np.ndarray:
    """Position of a point of the distal phalanx.

    Args:
        lengths: (3,) phalanx lengths [m].
        mcp: (...) angle [rad].
        pip: (...) angle [rad].
        dip: (...) angle [rad].
        along: (...) distance from the DIP [m]; the whole phalanx if None.

    Returns:
        Points (..., 2) [m].
    """
    first = np.asarray(mcp, dtype=float)
    second, third = first + pip, first + pip + dip
    last = lengths[2] if along is None else along
    x = lengths[0] * np.cos(first) + lengths[1] * np.cos(second) + last * np.cos(third)
    y = lengths[0] * np.sin(first) + lengths[1] * np.sin(second) + last * np.sin(third)
    return np.stack(np.broadcast_arrays(x, y), axis=-1)


def reachable(points: np.ndarray, lengths, ranges: Ranges, dip: float, along: float) -> np.ndarray:
    """Decide by inverse kinematics which points a point of the distal phalanx can reach at one DIP angle.

    The chain beyond the PIP acts as one link of length |e| and angle arg e; the law of cosines gives the PIP (two
    solutions) and the MCP.

    Args:
        points: (n, 2) points to reach [m].
        lengths: (3,) phalanx lengths [m].
        ranges: Ranges of motion.
        dip: DIP angle [rad].
        along: Distance of the point from the DIP [m].

    Returns:
        Mask (n,).
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
    from exodrake.core.errors import InputError

    for joint, length, (low, high) in zip(Ranges._fields, lengths, ranges, strict=True):
        if not length > 0:
            raise InputError(f"workspace: phalanx distal to {joint} has length {length} m")
        if not -np.pi < low < high < np.pi:
            raise InputError(f"workspace: range of {joint}, {low} .. {high} rad, does not rise within -pi .. pi")
