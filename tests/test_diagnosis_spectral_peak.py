"""Spectral peaks: a tremor found at its frequency and joint; noise and a single log are none."""

import numpy as np
import pytest
from diagnosis_cases import case_of

from exodrake.diagnosis import filters
from exodrake.diagnosis.detect import spectral_peak
from exodrake.diagnosis.detect.spectral_peak import Peak, find
from exodrake.diagnosis.problem import make_problem
from exodrake.machines.robot_file import load_robot

FREQUENCY = 7.3  # Hz


@pytest.fixture(scope="module")
def robot():
    return load_robot()


def detected(robot, planted):
    """The problem of a robot after the detector."""
    problem = make_problem(case_of(planted, 3), robot)
    return spectral_peak.detect(problem, robot.machine.effect("finger.tremor"), problem.silent())


def test_tremor_is_found_at_its_frequency_and_joint(robot):
    shaken = robot.splice("finger.tremor", {"torque": 4e-3, "frequency": FREQUENCY}, channels=["MCP"])
    found = detected(robot, shaken)
    (detection,) = found.detected
    assert detection.certain and detection.effect.joints == ("MCP",)
    assert detection.effect.parameters["frequency"].value == pytest.approx(FREQUENCY, abs=0.1)
    assert detection.effect.parameters["torque"].value == pytest.approx(4e-3, rel=0.5)
    assert any(low < FREQUENCY < high for low, high in found.notched) and "finger.tremor" not in found.tried


def test_healthy_robot_has_no_tremor(robot):
    found = detected(robot, robot)
    assert not found.detected and not found.notched and "finger.tremor" not in found.tried


def test_line_in_every_log_is_told_from_noise(robot):
    problem = make_problem(case_of(robot, 3, frames=200), robot)
    rng = np.random.default_rng(2)
    columns, time = len(problem.columns), np.arange(2000) * robot.machine.frame
    consistent = [rng.standard_normal((2000, columns)) for _ in range(3)]
    assert not find(problem, consistent).certain
    shaken = [log + 2.0 * np.sin(2 * np.pi * 6.3 * time + k)[:, None] for k, log in enumerate(consistent)]
    found = find(problem, shaken)
    assert found.certain and found.frequency == pytest.approx(6.3, abs=0.05)
    assert found.power == pytest.approx(np.full(columns, 2.0), rel=0.2)  # a^2 / 2 of a sine
    assert not find(problem, [consistent[0], consistent[1], shaken[2]]).certain  # in one log only: no tremor


def test_band_of_a_slow_line_can_be_filtered(robot):
    """A line at the slow end has no band below zero, which no filter takes."""
    slow = Peak(1.0, np.zeros(1), 10.0, 1.0)
    left = filters.without(slow.bands(25.0), np.ones((500, 1)), robot.machine.frame)
    assert np.isfinite(left).all()
