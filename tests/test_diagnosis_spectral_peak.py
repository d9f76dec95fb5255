"""Spectral peaks: a tremor found at its frequency and joint; noise and a single log are none."""

import numpy as np
import pytest
from diagnosis_cases import case_of

from exodrake.diagnosis.detect import spectral_peak
from exodrake.diagnosis.detect.spectral_peak import PROMINENT, Peak, find_peak, phase_rate
from exodrake.diagnosis.problem import make_problem
from exodrake.machines.robot_file import load_robot

FREQUENCY = 7.3  # Hz


@pytest.fixture(scope="module")
def robot():
    return load_robot()


def detected(robot, injected):
    """The problem of a robot after the detector."""
    problem = make_problem(case_of(injected, 3), robot)
    return spectral_peak.detect(problem, robot.machine.effect("finger.tremor"), problem.silent())


def test_tremor_is_found_at_its_frequency_and_joint(robot):
    trembling = robot.splice("finger.tremor", {"torque": 4e-3, "frequency": FREQUENCY}, channels=["MCP"])
    found = detected(robot, trembling)
    (detection,) = found.detected
    assert detection.certain and detection.effect.joints == ("MCP",)
    assert detection.effect.parameters["frequency"].value == pytest.approx(FREQUENCY, abs=0.1)
    assert detection.effect.parameters["torque"].value == pytest.approx(4e-3, rel=0.5)
    assert any(low < FREQUENCY < high for low, high in found.notched) and "finger.tremor" not in found.tried


def test_healthy_robot_has_no_tremor(robot):
    found = detected(robot, robot)
    assert not found.detected and not found.notched and "finger.tremor" not in found.tried


def test_line_in_every_log_is_distinguished_from_noise(robot):
    problem = make_problem(case_of(robot, 3, frames=200), robot)
    rng = np.random.default_rng(2)
    columns, time = len(problem.columns), np.arange(2000) * robot.machine.frame
    consistent = [rng.standard_normal((2000, columns)) for _ in range(3)]
    assert not find_peak(problem, consistent).certain
    with_peak = [log + 2.0 * np.sin(2 * np.pi * 6.3 * time + k)[:, None] for k, log in enumerate(consistent)]
    found = find_peak(problem, with_peak)
    assert found.certain and found.frequency == pytest.approx(6.3, abs=0.05)
    assert found.power == pytest.approx(np.full(columns, 2.0), rel=0.2)  # a^2 / 2 of a sine
    assert not find_peak(problem, [consistent[0], consistent[1], with_peak[2]]).certain  # in one log only: no tremor


@pytest.mark.parametrize(("frequency", "rate"), [(6.3, 0.0), (6.3, 0.5), (6.3, 2.0), (1.6, 0.5)])
def test_rate_of_a_wandering_phase_is_recovered(robot, frequency, rate):
    """Six logs of 60 s: the estimate of a rate of 2 rad^2/s scatters by 10 %."""
    rng, frame = np.random.default_rng(5), robot.machine.frame
    problem, time = make_problem(case_of(robot, 3, frames=100), robot), np.arange(3000) * frame
    logs = []
    for _ in range(6):
        phase = np.cumsum(np.sqrt(rate * frame) * rng.standard_normal(3000))
        logs.append(
            10.0 * np.sin(2 * np.pi * frequency * time + phase)[:, None] + rng.standard_normal((3000, 2)) * [1.0, 0.1]
        )
    found = phase_rate(problem, logs, Peak(frequency + 0.05, np.array([50.0, 49.0]), 10.0, 1.0))
    assert found == pytest.approx(rate, rel=0.3, abs=0.1)


def test_drawn_tremor_is_as_strong_as_the_simulated_one_and_repeats_no_phase(robot):
    trembling = robot.splice("finger.tremor", {"torque": 4e-3, "frequency": FREQUENCY}, channels=["MCP"])
    found = detected(robot, trembling)
    trial, (detection,), rng = found.fit[0], found.detected, np.random.default_rng(1)
    still = found.silent()
    still[robot.machine.index["finger.tremor.torque.MCP"]] = 0.0
    lines = found.predict(np.array([found.silent(), still]), trial)
    here = np.s_[50:, found.columns.index("angle_MCP")]
    line, noise = (lines[0] - lines[1])[here], detection.noise
    assert noise.args[-1] < 0.1  # the injected one keeps its phase
    drawn = [noise(found, found.silent(), trial, rng)[here] for _ in range(6)]
    assert np.mean([np.std(line + d) / np.std(line) for d in drawn]) == pytest.approx(1.0, rel=0.05)
    likeness = [np.corrcoef(line, line + d)[0, 1] for d in drawn]  # cosines of random phases
    assert np.abs(np.mean(likeness)) < 0.8 and np.ptp(likeness) > 0.3


def test_slow_bursts_are_no_tremor(robot):
    """A line at 0.9 Hz, whose shoulder reaches into the range of tremors."""
    problem = make_problem(case_of(robot, 3, frames=200), robot)
    rng, time = np.random.default_rng(2), np.arange(2000) * robot.machine.frame
    wave = 3.0 * np.sin(2 * np.pi * 0.9 * time + 0.2 * np.cumsum(rng.standard_normal(2000)))[:, None]
    found = find_peak(problem, [rng.standard_normal((2000, len(problem.columns))) + wave for _ in range(3)])
    assert found.prominence > PROMINENT and not found.certain
