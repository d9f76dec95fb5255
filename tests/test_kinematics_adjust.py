"""The bundle adjustment: its derivatives, its minimum and covariance against scipy, and intervals that hold."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from exodrake.identification.kinematics import identify as module
from exodrake.identification.kinematics.identify import (
    FREE,
    Finger,
    adjust,
    fit_frames,
    identify,
    measure,
    measures,
    shift_poses,
)
from exodrake.identification.kinematics.markers import Faults, Hand, Layout, Recording, Truth, synthesise
from exodrake.identification.kinematics.rigid import Axis, across, apply, fit_pose, inverse, triad_pose
from studies.identification import recordings

TIP = 1
REST, FRAMES, NOISE = 4, 20, 3e-4


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
    values, covariance = measure(found, TIP)
    half = np.sqrt(np.diag(covariance))
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
    found = recordings(8, seconds=10.0, rate=25.0)
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
