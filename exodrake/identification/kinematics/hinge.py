"""One-axis joints (PIP, DIP): axis, angle and centre in every frame of the recording (paper Eq. 7-12).

A finger joint keeps its axis while it turns, so the axis is estimated once from all frames and then held, which takes
the noise of the axis out of every centre. With the axis known, w x G^{-1} p of Eq. 8-12 is in closed form

    Q = 1/2 p + 1/2 cot(theta/2) w x p                p measured across w

and its error grows as 1/theta; frames weigh (2 sin(theta/2))^2, about theta^2, in everything that sums over them.
"""

import numpy as np

from exodrake.identification.kinematics.axis import across
from exodrake.identification.kinematics.screws import vee


def mean_axis(turns: np.ndarray) -> np.ndarray:
    """Unit direction (3,) of the axis common to all turns, positive towards the larger excursion (flexion).

    turns (frames, 3, 3) from the reference posture. Principal direction of w sin theta, so small angles weigh little.
    """
    sines = vee(turns)
    _, vectors = np.linalg.eigh(sines.T @ sines)
    axis = vectors[:, -1]
    along = sines @ axis
    return axis if np.sum(along * np.abs(along)) >= 0 else -axis


def angle_about(turns: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Signed angle (frames,) [rad] of each turn about the axis: the turn about it nearest to the measured one, by
    atan2.

    tan theta = w . vee(R - R^T)/2 over (tr R - w^T R w)/2, exact for a pure turn about w and unbiased near zero.
    """
    about = np.einsum("i,fij,j->f", axis, turns, axis)
    return np.arctan2(vee(turns) @ axis, (np.trace(turns, axis1=1, axis2=2) - about) / 2)


def centres(turns: np.ndarray, axis: np.ndarray, angle: np.ndarray, about: np.ndarray) -> np.ndarray:
    """Joint centre across the axis (frames, 3) [m], NaN at angle 0.

    turns (frames, 4, 4) from the reference posture; about (3,) [m] is a point near the joint and the markers: the
    residue of turns about other axes acts on the lever from there instead of from a distant origin.
    """
    moved = turns[:, :3, :3] @ about + turns[:, :3, 3] - about
    moved = across(moved, axis)
    with np.errstate(divide="ignore", invalid="ignore"):
        quarter = np.cross(axis, moved) / np.tan(angle / 2)[:, None]
    found = across(about, axis) + (moved + quarter) / 2
    found[angle == 0] = np.nan
    return found


def weight(angle: np.ndarray) -> np.ndarray:
    """Weight of a frame's centre, (2 sin(theta/2))^2: the inverse of its variance up to the markers' own noise."""
    return (2 * np.sin(angle / 2)) ** 2
