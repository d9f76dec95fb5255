"""The identification against scipy, closed forms and recordings with known truth; intervals that hold."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from exodrake.core.errors import InputError
from exodrake.identification.kinematics import identify as module
from exodrake.identification.kinematics.identify import (
    FREE,
    Finger,
    Kinematics,
    adjust,
    fit_frames,
    identify,
    measures,
    shift_poses,
)
from exodrake.identification.kinematics.markers import Faults, Hand, Layout, Recording, Truth, synthesise
from exodrake.identification.kinematics.report import robot_yaml, table_csv, table_markdown
from exodrake.identification.kinematics.rigid import (
    Axis,
    across,
    apply,
    centres,
    fit_pose,
    hat,
    inverse,
    motion,
    triad_pose,
)
from studies.identification import recordings
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
    far = motion(Rotation.from_rotvec(np.array([np.pi - 1e-6, 0.0, 0.0])).as_matrix(), np.array([1.0, 0.0, 0.0]))
    spun = joint_angles(
        axes[:1], motion(Rotation.from_rotvec(np.array([[0.0, 0.0, 0.3]])).as_matrix(), np.zeros((1, 3)))
    )
    assert spun[0, 0] == pytest.approx(0.3)
    with pytest.raises(InputError, match="does not converge in 1 of 1 frames"):
        joint_angles(axes[:1], far[None], np.array([[1.0]]))


@pytest.mark.parametrize(("degrees", "rms", "off"), [(5, 7.0, 774), (30, 1.2, 96), (89, 0.4, 7)])
def test_centres_err_as_one_over_the_angle_and_are_misplaced_by_the_printed_g_inverse(degrees, rms, off):
    """0.3 mm and 0.5 deg on the moving frame, centre 20 mm from the origin: physics.md 1.9 to 1.13, statistically."""
    rng, theta, w = np.random.default_rng(degrees), np.deg2rad(degrees), np.array([0.0, 0.0, 1.0])
    true = Axis(w, np.array([20.0, 0.0, 0.0]), np.zeros(3)).pose(theta)
    ways = rng.standard_normal((4000, 3)) * np.deg2rad(0.5)
    noisy = motion(
        Rotation.from_rotvec(ways).as_matrix() @ true[:3, :3], true[:3, 3] + 0.3 * rng.standard_normal((4000, 3))
    )
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
    pose = motion(Rotation.from_rotvec(2.2 * TILTED).as_matrix(), np.array([0.3, -0.1, 0.2]))
    found, left = fit_pose(shape, apply(pose, shape)[None])
    np.testing.assert_allclose(found[0], pose, atol=1e-14)
    assert left[0] < 1e-15


NOISE = 3e-4


@pytest.fixture(scope="module")
def clean() -> tuple[Kinematics, Truth]:
    recording, truth = synthesise(Hand(), Faults(), 12.0, 50.0, 0)
    return identify(recording, cutoff=None), truth


@pytest.fixture(scope="module")
def noisy() -> tuple[Kinematics, Truth]:
    recording, truth = synthesise(Hand(), Faults(noise=NOISE, dropouts=6), 15.0, 50.0, 5)
    return identify(recording), truth


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(error**2)))


def test_noise_free_truth_is_recovered(clean):
    found, truth = clean
    np.testing.assert_allclose(found.lengths, truth.lengths, atol=1e-9)
    np.testing.assert_allclose(found.joints[0].abduction, truth.angles[:, 0], atol=1e-9)
    for number, joint in enumerate(found.joints, start=1):
        axis = truth.axes[number]
        np.testing.assert_allclose(joint.angle, truth.angles[:, number], atol=1e-9)
        np.testing.assert_allclose(joint.axis.direction, axis.direction, atol=1e-9)
        np.testing.assert_allclose(joint.axis.slope, axis.slope, atol=1e-9)
        np.testing.assert_allclose(joint.axis.point, axis.point, atol=1e-9)
        assert joint.rmse.max() < 1e-9
    np.testing.assert_allclose(found.joints[0].abduction_axis.direction, truth.axes[0].direction, atol=1e-9)


def test_centres_beyond_45_degrees_are_within_a_millimetre(noisy):
    found, truth = noisy
    for number, joint in enumerate(found.joints, start=1):
        axis, angle = truth.axes[number], truth.angles[:, number]
        beyond = np.abs(angle) > np.pi / 4
        error = np.linalg.norm(across(joint.centre - axis.centre(angle), axis.direction), axis=1)[beyond]
        assert _rms(error) < 0.3e-3
        assert np.nanquantile(error, 0.99) < 1e-3
    np.testing.assert_allclose(found.lengths, truth.lengths, atol=0.5e-3)


def test_skin_that_slides_shows_as_bias_beyond_the_intervals():
    """The intervals count noise only, and the report says so: an artefact of 2 mm/rad moves a length by more."""
    recording, truth = synthesise(Hand(), Faults(noise=NOISE, artefact=2e-3), 12.0, 25.0, 0)
    found = identify(recording)
    off = np.abs(np.subtract(found.lengths, truth.lengths))
    assert off.max() > max(found.intervals) and off.max() < 8e-3
    assert "skin" in table_markdown(found)


def test_hand_without_abduction_is_still_identified():
    recording, truth = synthesise(Hand(abduction=(-0.001, 0.001)), Faults(noise=1e-4), 8.0, 20.0, 2)
    found = identify(recording)
    assert np.rad2deg(_rms(found.joints[0].angle - truth.angles[:, 1])) < 0.5
    np.testing.assert_allclose(found.lengths, truth.lengths, atol=1e-3)


def test_tables_and_robot_file_say_what_was_found(clean):
    found, _ = clean
    rows = table_csv(found).splitlines()
    assert rows[0].startswith("joint,axis,gradient [mm/rad]") and len(rows) == 1 + 9 + 3
    assert "| MCP | X |" in table_markdown(found)
    assert "finger.length.MCP: 0.04264  # +- " in robot_yaml(found)
    assert "source:" in robot_yaml(found)


TIP = 1
REST, FRAMES = 4, 20


def few_frames(seed: int = 0) -> tuple[np.ndarray, np.ndarray, Finger, np.ndarray, Truth]:
    """Points (frames, 12, 3), mask of the rest, true finger and poses, and truth of a thinned synthetic recording."""
    clean, truth = synthesise(Hand(), Faults(), 8.0, 50.0, seed)
    rows = np.r_[np.arange(0, 50, 50 // REST)[:REST], np.linspace(120, 399, FRAMES - REST).astype(int)]
    points = clean.of(Layout().finger)[rows]
    shapes = points[0].reshape(4, 3, 3)
    markers = apply(inverse(triad_pose(shapes[0])), shapes)
    finger = Finger(markers, in_base(truth, markers))
    poses = fit_pose(markers[0], points[:, :3])[0]
    points = points + NOISE * np.random.default_rng(seed).standard_normal(points.shape)
    return points, np.arange(FRAMES) < REST, finger, poses, Truth(truth.angles[rows], truth.axes, truth.lengths)


def in_base(truth: Truth, markers: np.ndarray):
    """True axes, each given in the frame of the triad before it, in that of the base triad."""
    axes = []
    for axis, number in zip(truth.axes, (0, 0, 1, 2)):
        pose = triad_pose(markers[number])
        w = pose[:3, :3] @ axis.direction
        axes.append(Axis(w, across(apply(pose, axis.point[None])[0], w), pose[:3, :3] @ axis.slope))
    return tuple(axes)


def test_derivatives_are_difference_quotients():
    _, _, finger, _, truth = few_frames()
    angles, step = truth.angles[::8], 1e-6
    by_angle = finger.differentiate_angles(finger.places(angles), angles)
    for number in range(4):
        way = step * np.eye(4)[number]
        slope = (finger.places(angles + way) - finger.places(angles - way)) / (2 * step)
        np.testing.assert_allclose(by_angle[..., number], slope, atol=1e-8)


def test_minimum_and_covariance_are_those_of_scipy_on_all_unknowns_at_once(monkeypatch):
    """Without prior: 51 unknowns of the finger and ten of each frame in one dense problem, the constraint a weight."""
    monkeypatch.setattr(module, "PRIOR", np.zeros_like(module.PRIOR))
    points, rest, finger, poses, truth = few_frames()
    found = adjust(points, rest, finger, poses, truth.angles, FRAMES)
    free = finger.free()

    def residual(x):
        moves = x[FREE:].reshape(FRAMES, 10)
        angles = truth.angles + moves[:, 6:]
        gap = points - apply(shift_poses(poses, moves), finger.shift(free @ x[:FREE]).places(angles))
        return np.r_[gap.ravel(), 1e3 * angles[rest].sum(axis=0)]

    dense = least_squares(residual, np.zeros(FREE + 10 * FRAMES), x_scale="jac", xtol=1e-12, ftol=1e-12)
    best = finger.shift(free @ dense.x[:FREE])
    values, change = measures(found.finger, TIP), found.finger.differentiate(measures, TIP)
    half = np.sqrt(np.diag(change @ found.covariance @ change.T))
    assert np.max(np.abs(values - measures(best, TIP)) / half) < 1e-2
    dense_covariance = np.linalg.inv(dense.jac.T @ dense.jac)[:FREE, :FREE]
    variance = 2 * dense.cost / (points.size - FREE - 10 * FRAMES)
    slope = np.stack(
        [(measures(finger.shift(1e-6 * w), TIP) - measures(finger.shift(-1e-6 * w), TIP)) / 2e-6 for w in free.T],
        axis=1,
    )
    wanted = np.sqrt(variance * np.diag(slope @ dense_covariance @ slope.T))
    np.testing.assert_allclose(half / np.sqrt(found.inflation), wanted, rtol=0.05)


def test_frames_fitted_alone_give_back_their_angles_with_single_markers_missing():
    points, _, finger, poses, truth = few_frames()
    clean = apply(poses, finger.places(truth.angles))
    clean[::3, 4] = clean[1::3, 11] = np.nan
    np.testing.assert_allclose(fit_frames(clean, finger, poses, truth.angles + 0.1)[1], truth.angles, atol=1e-7)
    assert np.isfinite(fit_frames(points, finger, poses, truth.angles)[1]).all()


def test_intervals_hold_the_truth_in_95_of_100():
    """A short form of `python -m studies.identification`, which takes 200 recordings."""
    found = recordings(8, seconds=6.0, rate=20.0)
    assert 0.88 < found.inside.mean() < 0.995
    assert 0.7 < np.mean((1.96 * found.errors / found.halves) ** 2) < 1.4


def test_errors_that_last_widen_the_intervals():
    """A mean over ten frames leaves errors of a tenth of the variance that last for ten frames."""
    clean, _ = synthesise(Hand(), Faults(), 12.0, 50.0, 0)
    noise = NOISE * np.random.default_rng(0).standard_normal((len(clean.time) + 9, *clean.positions.shape[1:]))
    sums = np.cumsum(np.concatenate([np.zeros((1, *noise.shape[1:])), noise]), axis=0)
    lasting = clean.positions + (sums[10:] - sums[:-10]) / 10
    found = identify(Recording(clean.names, clean.time, lasting))
    assert found.noise == pytest.approx(NOISE / np.sqrt(10), rel=0.1)
    assert 5 < found.inflation < 11
