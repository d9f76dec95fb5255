"""Screws: closed forms, inverses, and the paper's printed G^{-1} against the corrected one (physics.md 1.9-1.13)."""

import numpy as np
import pytest
from scipy.linalg import expm, logm

from exodrake.core.errors import InputError
from exodrake.identification.kinematics.rigid import (
    Axis,
    across,
    angle_about,
    apply,
    centres,
    chain_pose,
    hat,
    inverse,
    joint_points,
    kabsch,
    motion,
    rotation,
    turned_by,
)
from exodrake.identification.kinematics.screws import (
    adjoint,
    exponential,
    g_inverse,
    g_matrix,
    joint_angles,
    joint_centre,
    logarithm,
    newton_step,
    rotation_vector,
    velocity,
)
from studies.paper.printed_equations import g_inverse_as_printed

TILTED = np.array([2.0, -1.0, 2.0]) / 3.0


def _screws(count: int = 50) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    w = rng.standard_normal((count, 3))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    return np.concatenate([w, rng.standard_normal((count, 3))], axis=1), rng.uniform(0.01, 3.1, count)


def _bracket(screw: np.ndarray) -> np.ndarray:
    matrix = np.zeros((4, 4))
    matrix[:3, :3], matrix[:3, 3] = hat(screw[:3]), screw[3:]
    return matrix


def test_exponential_is_the_matrix_exponential():
    screws, angles = _screws()
    for screw, angle in zip(screws, angles, strict=True):
        np.testing.assert_allclose(exponential(screw, angle), expm(_bracket(screw) * angle), atol=1e-13)


def test_logarithm_is_the_matrix_logarithm():
    screws, angles = _screws(20)
    for screw, angle in zip(screws, angles, strict=True):
        pose = exponential(screw, angle)
        np.testing.assert_allclose(_bracket(logarithm(pose)), np.real(logm(pose)), atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 9.99e-3, 1.01e-2, 0.5, 3.0, np.pi - 1e-3, np.pi - 1e-9])
def test_logarithm_undoes_exponential_down_to_zero_and_up_to_pi(angle):
    screw = np.r_[TILTED, 0.03, -0.02, 0.05]
    np.testing.assert_allclose(logarithm(exponential(screw, angle)), screw * angle, atol=2e-8 if angle > 3.1 else 1e-14)


def test_half_turns_about_the_axes():
    for axis in np.eye(3):
        found = rotation_vector(rotation(axis, np.pi))
        np.testing.assert_allclose(np.abs(found), np.pi * axis, atol=1e-12)


def test_rotation_of_a_vector_is_rodrigues_formula():
    vectors = np.random.default_rng(3).standard_normal((20, 3))
    size = np.linalg.norm(vectors, axis=1)
    np.testing.assert_allclose(turned_by(vectors), rotation(vectors / size[:, None], size), atol=1e-14)


@pytest.mark.parametrize(("degrees", "printed"), [(5, 31.0), (30, 3.85), (60, 1.11), (89, 0.29)])
def test_corrected_g_inverse_inverts_and_the_printed_one_does_not(degrees, printed):
    theta = np.deg2rad(degrees)
    g = g_matrix(TILTED, theta)
    assert np.linalg.norm(g @ g_inverse(TILTED, theta) - np.eye(3)) < 1e-14
    assert np.linalg.norm(g @ g_inverse_as_printed(TILTED, theta) - np.eye(3)) == pytest.approx(printed, rel=0.005)
    assert printed == pytest.approx(2 * np.sqrt(2) * np.cos(theta / 2) * (1 / theta - 1 / 2), rel=0.005)  # by hand


@pytest.mark.parametrize(("degrees", "off"), [(5, 774), (10, 368), (30, 96), (60, 28), (89, 7)])
def test_printed_g_inverse_misplaces_the_centre(degrees, off):
    centre, w, theta = np.array([35.0, 5.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.deg2rad(degrees)
    pose = Axis(w, centre, np.zeros(3)).pose(theta)
    printed = np.cross(w, g_inverse_as_printed(w, theta) @ pose[:3, 3])
    corrected = np.cross(w, g_inverse(w, theta) @ pose[:3, 3])
    assert np.linalg.norm(corrected - centre) < 1e-11
    assert np.linalg.norm(printed - centre) == pytest.approx(off, abs=0.6)


def test_sliding_along_the_axis_does_not_move_the_centre():
    w, centre = np.array([0.0, 0.0, 1.0]), np.array([35.0, 5.0, 0.0])
    pose = exponential(np.r_[w, np.cross(centre, w) + 4.0 * w], 0.7)
    screw = logarithm(pose) / 0.7
    np.testing.assert_allclose(screw[:3], w, atol=1e-12)
    np.testing.assert_allclose(np.cross(w, screw[3:]), centre, atol=1e-12)
    speed = np.linalg.norm(screw[3:])  # Eq. 13 takes |v|
    assert speed == pytest.approx(35.58, abs=0.005)
    assert np.linalg.norm(centre) == pytest.approx(35.36, abs=0.005)


def test_hinge_centre_is_the_product_of_exponentials_in_closed_form():
    w, centre = TILTED, across(np.array([0.03, 0.01, -0.02]), TILTED)
    angle = np.array([-0.4, 0.05, 0.9, 1.5])
    turns = Axis(w, centre, np.zeros(3)).pose(angle)
    for about in (np.zeros(3), np.array([0.1, 0.2, -0.3])):
        np.testing.assert_allclose(centres(turns, w, angle, about), np.broadcast_to(centre, (4, 3)), atol=1e-14)
    np.testing.assert_allclose(np.cross(w, logarithm(turns)[:, 3:] / angle[:, None]), [centre] * 4, atol=1e-14)
    np.testing.assert_allclose(angle_about(turns[:, :3, :3], w), angle, atol=1e-15)


@pytest.mark.parametrize(("degrees", "rms"), [(3, 12.0), (5, 7.0), (10, 3.5), (20, 1.8), (45, 0.8), (90, 0.4)])
def test_centre_error_falls_as_one_over_the_angle(degrees, rms):
    """0.3 mm and 0.5 deg on the moving frame, centre 40 mm from the origin: physics.md 1.10-13, statistically."""
    rng, count = np.random.default_rng(degrees), 4000
    true = Axis(np.array([0.0, 0.0, 1.0]), np.array([20.0, 0.0, 0.0]), np.zeros(3)).pose(np.deg2rad(degrees))
    ways = rng.standard_normal((count, 3)) * np.deg2rad(0.5)
    size = np.linalg.norm(ways, axis=1)
    noisy = motion(
        rotation(ways / size[:, None], size) @ true[:3, :3], true[:3, 3] + 0.3 * rng.standard_normal((count, 3))
    )
    angle = angle_about(noisy[:, :3, :3], np.array([0.0, 0.0, 1.0]))
    found = centres(noisy, np.array([0.0, 0.0, 1.0]), angle, np.zeros(3))
    error = np.median(np.linalg.norm(found - np.array([20.0, 0.0, 0.0]), axis=1))
    assert 0.4 * rms < error < 1.6 * rms


def test_newton_on_the_space_jacobian_converges_quadratically_and_diverges_with_the_other_sign():
    """physics.md 1.15-18: 5e-2, 3e-4, 1.5e-8, 1.8e-15 with Eq. 16's sign; with + it diverges."""
    axes = (
        Axis(np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 0.002]), np.zeros(3)),
        Axis(np.array([0.0, 0.0, -1.0]), np.array([0.001, 0.0, 0.0]), np.zeros(3)),
    )
    wanted = np.array([[0.2, 0.9]])
    turns = chain_pose(axes, wanted)
    good, bad, errors = np.zeros((1, 2)) + 0.6, np.zeros((1, 2)) + 0.6, []
    for _ in range(5):
        good = good + newton_step(axes, turns, good)
        bad = bad - newton_step(axes, turns, bad)
        errors.append(np.max(np.abs(good - wanted)))
    assert errors[0] < 0.2 and errors[2] < 1e-4 and errors[4] < 1e-14
    assert errors[2] < 10 * errors[1] ** 2
    assert np.max(np.abs(bad - wanted)) > 1


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
    far = motion(rotation(np.array([1.0, 0.0, 0.0]), np.pi - 1e-6), np.array([1.0, 0.0, 0.0]))
    spun = joint_angles(axes[:1], motion(rotation(axes[0].direction, np.array([0.3])), np.zeros((1, 3))))
    assert spun[0, 0] == pytest.approx(0.3)
    with pytest.raises(InputError, match="does not converge in 1 of 1 frames"):
        joint_angles(axes[:1], far[None], np.array([[1.0]]))


def test_joint_centre_is_the_axis_point_nearest_the_origin():
    centre = across(np.array([0.03, 0.01, -0.02]), TILTED)
    turns = Axis(TILTED, centre, np.zeros(3)).pose(np.array([-0.4, 0.9, 0.0]))
    turns[0, :3, 3] += 0.004 * TILTED  # a slide along the axis
    found = joint_centre(turns)
    np.testing.assert_allclose(found[:2], [centre] * 2, atol=1e-14)
    assert np.isnan(found[2]).all()


def test_moving_axis_velocity_is_the_derivative_of_its_pose():
    axis, h = Axis(TILTED, np.array([0.03, 0.01, 0.0]), np.array([-0.003, 0.002, 0.001])), 1e-6
    for theta in (0.0, 0.4, 1.3):
        twist = logarithm(axis.pose(theta + h) @ inverse(axis.pose(theta - h))) / (2 * h)
        np.testing.assert_allclose(velocity(axis, np.array(theta)), twist, atol=1e-9)


def test_adjoint_carries_a_screw():
    screws, angles = _screws(2)
    pose = exponential(screws[0], angles[0])
    carried = adjoint(pose) @ screws[1]
    np.testing.assert_allclose(_bracket(carried), pose @ _bracket(screws[1]) @ inverse(pose), atol=1e-12)


def test_frame_change_of_eq_4_and_6():
    pose = motion(rotation(TILTED, 0.8), np.array([0.3, -0.1, 0.2]))  # of M in F
    point = np.array([[0.5, 0.4, -0.3]])
    np.testing.assert_allclose(apply(inverse(pose), point), (point - pose[:3, 3]) @ pose[:3, :3], atol=1e-15)


def test_kabsch_recovers_the_pose_and_reports_the_residual():
    shape = np.array([[0.0, 0, 0], [0.02, 0, 0], [0.005, 0.012, 0]])
    pose = motion(rotation(TILTED, 2.2), np.array([0.3, -0.1, 0.2]))
    found, left = kabsch(shape, apply(pose, shape)[None])
    np.testing.assert_allclose(found[0], pose, atol=1e-14)
    assert left[0] < 1e-15
    assert np.linalg.det(found[0, :3, :3]) == pytest.approx(1.0)


def test_length_between_parallel_axes_ignores_the_place_along_them():
    w = np.array([0.0, 0.0, -1.0])
    near = Axis(w, np.array([0.01, 0.002, 0.4]), np.zeros(3))
    far = Axis(w, np.array([0.05, 0.032, -0.7]), np.zeros(3))
    start, end, normal = joint_points(near, far, np.zeros(3))
    assert np.linalg.norm(end - start) == pytest.approx(0.05)
    np.testing.assert_allclose(normal, w)
