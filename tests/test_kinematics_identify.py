"""The identification on recordings with known truth: noise-free to rounding, with 0.3 mm noise within bounds."""

import numpy as np
import pytest

from exodrake.identification.kinematics.identify import Kinematics, identify
from exodrake.identification.kinematics.markers import Faults, Hand, Truth, synthesise
from exodrake.identification.kinematics.report import robot_yaml, table_csv, table_markdown
from exodrake.identification.kinematics.rigid import across

NOISE = 3e-4


@pytest.fixture(scope="module")
def clean() -> tuple[Kinematics, Truth]:
    recording, truth = synthesise(Hand(), Faults(), 12.0, 50.0, 0)
    return identify(recording, cutoff=None), truth


@pytest.fixture(scope="module")
def noisy() -> tuple[Kinematics, Truth]:
    recording, truth = synthesise(Hand(), Faults(noise=NOISE, dropouts=6), 25.0, 100.0, 5)
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
    """The intervals count noise only, and the report says so: an artefact of 1 mm/rad moves a length by more."""
    recording, truth = synthesise(Hand(), Faults(noise=NOISE, artefact=1e-3), 20.0, 100.0, 0)
    found = identify(recording)
    off = np.abs(np.subtract(found.lengths, truth.lengths))
    assert off.max() > max(found.intervals) and off.max() < 4e-3
    assert "skin" in table_markdown(found)


def test_hand_without_abduction_is_still_identified():
    recording, truth = synthesise(Hand(abduction=(-0.001, 0.001)), Faults(noise=1e-4), 12.0, 50.0, 2)
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
