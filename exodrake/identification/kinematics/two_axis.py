"""Estimation of the two axes of the MCP joint from all frames.

The paper's Eq. 14 takes S1 (abduction, fixed to the hand) and S2 (flexion) as known. Here they follow from nonlinear
least squares over all poses with nine parameters: rotation of the pair of perpendicular directions (3), position of
the abduction axis (2), position of the flexion axis (2) and its slope over the angle (2). The angles of each frame are
eliminated by Newton's iteration (`newton.joint_angles`).

The axes are perpendicular by convention: a component of S1 along S2 is, to first order in abduction, a change of the
flexion angle, and cannot be distinguished from it.
"""

import numpy as np

from exodrake.identification.kinematics.axis import Axis, across
from exodrake.identification.kinematics.hinge import angle_about, centres, mean_axis, weight
from exodrake.identification.kinematics.newton import chain_pose, joint_angles
from exodrake.identification.kinematics.screws import inverse, logarithm, rotation, rotation_vector, vee

FRAMES = 240  # frames used to find the axes; the angles are then solved in all of them
LEVER = 0.02  # m; scales the rotation parameters to lengths of the size of a triad
STILL = 0.04  # rad RMS; less abduction does not determine its axis


def two_axes(turns: np.ndarray, markers: np.ndarray, metric: np.ndarray) -> tuple[Axis, Axis]:
    """Estimate abduction axis and flexion axis in the proximal frame.

    Flexion is positive towards the larger excursion; abduction is about distal x flexion, which points dorsally.

    Args:
        turns: (frames, 4, 4) motions from the reference posture [m].
        markers: (3, 3) markers of the distal segment in that posture [m].
        metric: (frames, 6, 6) of `pose_metric`.
    """
    from scipy.optimize import least_squares

    chosen = np.unique(np.linspace(0, len(turns) - 1, FRAMES).astype(int))
    some, near = turns[chosen], metric[chosen]
    half = np.swapaxes(np.linalg.cholesky(near), 1, 2)
    pair, origin = _first_guess(some, markers)
    free = _free(some, pair)

    def residual(values: np.ndarray) -> np.ndarray:
        axes = _axes(_embedded(values, free), pair, origin)
        placed = chain_pose(axes, joint_angles(axes, some, near))
        gap = half @ logarithm(placed @ inverse(some))[:, :, None]
        return np.nan_to_num(gap, nan=1.0).ravel()

    found = least_squares(residual, np.zeros(int(free.sum())), method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return _axes(_embedded(found.x, free), pair, origin)


def _first_guess(turns: np.ndarray, markers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimate (abduction, flexion, their cross product) (3, 3) and a centre (3,) [m] as of a one-axis joint."""
    flexion = mean_axis(turns[:, :3, :3])
    about = markers.mean(axis=0)
    angle = angle_about(turns[:, :3, :3], flexion)
    near, share = centres(turns, flexion, angle, about), weight(angle)
    near, share = near[share > 0], share[share > 0]
    centre = share @ near / share.sum() + flexion * (about @ flexion)
    sideways = vee(turns[:, :3, :3])
    _, directions = np.linalg.eigh(across(sideways, flexion).T @ across(sideways, flexion))
    abduction = across(directions[:, -1], flexion)
    abduction = abduction / np.linalg.norm(abduction)
    if np.cross(about - centre, flexion) @ abduction < 0:
        abduction = -abduction
    return np.stack([abduction, flexion, np.cross(abduction, flexion)]), centre


def _free(turns: np.ndarray, pair: np.ndarray) -> np.ndarray:
    """Mask (9,) of the parameters to fit; without abduction its axis stays at the initial guess."""
    sideways = rotation_vector(turns[:, :3, :3]) @ pair[0]
    free = np.ones(9, dtype=bool)
    if np.sqrt(np.mean(sideways**2)) < STILL:
        free[[1, 3, 4]] = False
    return free


def _embedded(values: np.ndarray, free: np.ndarray) -> np.ndarray:
    full = np.zeros(len(free))
    full[free] = values
    return full


def _axes(values: np.ndarray, pair: np.ndarray, origin: np.ndarray) -> tuple[Axis, Axis]:
    """Build the axes from the nine parameters [m], the slopes [m/rad]."""
    turn = pair.T @ (values[:3] / LEVER)
    size = np.linalg.norm(turn)
    turned = pair if size == 0 else pair @ rotation(turn / size, size).T
    abduction, flexion, third = turned
    place = origin + values[3] * flexion + values[4] * third
    beside = origin + values[5] * abduction + values[6] * third
    slope = values[7] * abduction + values[8] * third
    return Axis(abduction, across(place, abduction), np.zeros(3)), Axis(flexion, across(beside, flexion), slope)
