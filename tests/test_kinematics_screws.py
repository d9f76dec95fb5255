"""Screws: closed forms, inverses, and the paper's printed G^{-1} against the corrected one (physics.md 1.9-1.13)."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import RigidTransform

from exodrake.core.errors import InputError
from exodrake.identification.kinematics.rigid import Axis, apply, centres, fit_pose, hat, inverse, motion, rotation
from studies.paper.printed_equations import g_inverse, g_matrix, joint_angles

TILTED = np.array([2.0, -1.0, 2.0]) / 3.0


def _bracket(screw: np.ndarray) -> np.ndarray:
    matrix = np.zeros((4, 4))
    matrix[:3, :3], matrix[:3, 3] = hat(screw[:3]), screw[3:]
    return matrix


@pytest.mark.parametrize(("degrees", "printed"), [(5, 31.0), (30, 3.85), (60, 1.11), (89, 0.29)])
def test_corrected_g_inverse_inverts_and_the_printed_one_does_not(degrees, printed):
    theta = np.deg2rad(degrees)
    g = g_matrix(TILTED, theta)
    assert np.linalg.norm(g @ g_inverse(TILTED, theta) - np.eye(3)) < 1e-14
    assert np.linalg.norm(g @ g_inverse(TILTED, theta, printed=True) - np.eye(3)) == pytest.approx(printed, rel=0.005)
    assert printed == pytest.approx(2 * np.sqrt(2) * np.cos(theta / 2) * (1 / theta - 1 / 2), rel=0.005)  # by hand


def test_joint_angles_of_a_two_axis_joint_are_found_where_there_is_a_pose():
    """The MCP: abduction about y, then flexion about -z, as products of matrix exponentials (Eq. 14)."""
    axes = (
        Axis(np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 0.002]), np.zeros(3)),
        Axis(np.array([0.0, 0.0, -1.0]), np.array([0.035, 0.005, 0.0]), np.zeros(3)),
    )
    wanted = np.random.default_rng(2).uniform((-0.3, -0.3), (0.3, 1.4), (40, 2))
    screw = [np.r_[a.direction, -np.cross(a.direction, a.point)] for a in axes]
    turns = np.array([expm(_bracket(screw[0]) * a) @ expm(_bracket(screw[1]) * b) for a, b in wanted])
    turns[7] = np.nan
    found = joint_angles(axes, turns)
    assert np.isnan(found[7]).all()
    np.testing.assert_allclose(np.delete(found, 7, axis=0), np.delete(wanted, 7, axis=0), atol=1e-12)
    np.testing.assert_allclose(joint_angles(axes, turns[:7], wanted[:7] + 0.2), wanted[:7], atol=1e-12)


def test_joint_angles_that_do_not_converge_are_refused():
    """A single axis, moved across itself by half a turn: no angle about it is near, and the steps do not end."""
    axes = (Axis(np.array([0.0, 0.0, 1.0]), np.zeros(3), np.zeros(3)),) * 2
    far = motion(rotation(np.array([np.pi - 1e-6, 0.0, 0.0])), np.array([1.0, 0.0, 0.0]))
    spun = joint_angles(axes[:1], motion(rotation(np.array([[0.0, 0.0, 0.3]])), np.zeros((1, 3))))
    assert spun[0, 0] == pytest.approx(0.3)
    with pytest.raises(InputError, match="does not converge in 1 of 1 frames"):
        joint_angles(axes[:1], far[None], np.array([[1.0]]))


@pytest.mark.parametrize(("degrees", "rms", "off"), [(5, 7.0, 774), (30, 1.2, 96), (89, 0.4, 7)])
def test_centres_err_as_one_over_the_angle_and_are_misplaced_by_the_printed_g_inverse(degrees, rms, off):
    """0.3 mm and 0.5 deg on the moving frame, centre 20 mm from the origin: physics.md 1.9 to 1.13, statistically."""
    rng, theta, w = np.random.default_rng(degrees), np.deg2rad(degrees), np.array([0.0, 0.0, 1.0])
    true = Axis(w, np.array([20.0, 0.0, 0.0]), np.zeros(3)).pose(theta)
    ways = rng.standard_normal((4000, 3)) * np.deg2rad(0.5)
    noisy = motion(rotation(ways) @ true[:3, :3], true[:3, 3] + 0.3 * rng.standard_normal((4000, 3)))
    found = centres(noisy, w, np.arctan2(noisy[:, 1, 0], noisy[:, 0, 0]), np.zeros(3))
    assert 0.4 * rms < np.median(np.linalg.norm(found - [20.0, 0.0, 0.0], axis=1)) < 1.6 * rms
    centre = np.array([35.0, 5.0, 0.0])
    shift = Axis(w, centre, np.zeros(3)).pose(theta)[:3, 3]
    printed, corrected = (np.cross(w, g_inverse(w, theta, printed=p) @ shift) for p in (True, False))
    assert np.linalg.norm(corrected - centre) < 1e-11
    assert np.linalg.norm(printed - centre) == pytest.approx(off, abs=0.6)


def test_moving_axis_velocity_is_the_derivative_of_its_pose():
    axis, h = Axis(TILTED, np.array([0.03, 0.01, 0.0]), np.array([-0.003, 0.002, 0.001])), 1e-6
    for theta in (0.0, 0.4, 1.3):
        step = RigidTransform.from_matrix(axis.pose(theta + h) @ inverse(axis.pose(theta - h)))
        np.testing.assert_allclose(axis.velocity(np.array(theta)), step.as_exp_coords() / (2 * h), atol=1e-9)


def test_fitted_pose_is_the_true_one_and_reports_the_residual():
    shape = np.array([[0.0, 0, 0], [0.02, 0, 0], [0.005, 0.012, 0]])
    pose = motion(rotation(2.2 * TILTED), np.array([0.3, -0.1, 0.2]))
    found, left = fit_pose(shape, apply(pose, shape)[None])
    np.testing.assert_allclose(found[0], pose, atol=1e-14)
    assert left[0] < 1e-15
