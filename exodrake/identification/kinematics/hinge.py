"""One-axis joints (PIP, DIP): axis, angle and centre in every frame of the recording (paper Eq. 7-12).

A finger joint has a constant axis, so the axis is estimated once from all frames, which removes the noise of the axis
from every centre. With the axis known, w x G^{-1} p of Eq. 8-12 has the closed form

    Q = 1/2 p + 1/2 cot(theta/2) w x p                p normal to w

with an error that grows as 1/theta. Frames therefore have the weight (2 sin(theta/2))^2, about theta^2, in all sums.
"""

import numpy as np

from exodrake.identification.kinematics.axis import across
from exodrake.identification.kinematics.rigid import vee


def mean_axis(turns: np.ndarray) -> np.ndarray:
    """Estimate the unit direction (3,) [-] of the common axis of rotations (frames, 3, 3) from the reference posture.

    It is the principal direction of w sin theta, so small angles have little weight; positive towards the larger
    excursion (flexion).
    """
    sines = vee(turns)
    _, vectors = np.linalg.eigh(sines.T @ sines)
    axis = vectors[:, -1]
    along = sines @ axis
    return axis if np.sum(along * np.abs(along)) >= 0 else -axis


def angle_about(turns: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Signed angle (frames,) [rad] about an axis (3,) nearest to each rotation (frames, 3, 3).

    tan theta = (w . vee(R - R^T) / 2) / ((tr R - w^T R w) / 2), exact for a rotation about w and unbiased near zero.
    """
    about = np.einsum("i,fij,j->f", axis, turns, axis)
    return np.arctan2(vee(turns) @ axis, (np.trace(turns, axis1=1, axis2=2) - about) / 2)


def centres(turns: np.ndarray, axis: np.ndarray, angle: np.ndarray, about: np.ndarray) -> np.ndarray:
    """Joint centre normal to the axis in every frame.

    Args:
        turns: (frames, 4, 4) motions from the reference posture [m].
        axis: (3,) unit direction.
        angle: (frames,) angle about the axis [rad].
        about: (3,) point near the joint and the markers [m]; residual rotations about other axes act on the lever from
            this point instead of from a distant origin.

    Returns:
        Centres (frames, 3) [m], NaN at angle 0.
    """
    moved = turns[:, :3, :3] @ about + turns[:, :3, 3] - about
    moved = across(moved, axis)
    with np.errstate(divide="ignore", invalid="ignore"):
        quarter = np.cross(axis, moved) / np.tan(angle / 2)[:, None]
    found = across(about, axis) + (moved + quarter) / 2
    found[angle == 0] = np.nan
    return found


def weight(angle: np.ndarray) -> np.ndarray:
    """Weight (2 sin(theta/2))^2 (frames,) [-] of centres at angles (frames,) [rad]: their inverse relative variance."""
    return (2 * np.sin(angle / 2)) ** 2
