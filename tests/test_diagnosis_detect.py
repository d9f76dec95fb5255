"""Detectors: packet loss decoded from logs, a tremor at its frequency and joint; noise and bad drives are neither."""

import numpy as np
import pytest
from diagnosis_cases import case_of

from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.detect import packet_loss, spectral_peak
from exodrake.diagnosis.detect.spectral_peak import PROMINENT, Peak, find_peak, phase_rate
from exodrake.diagnosis.likelihood import written_by
from exodrake.diagnosis.problem import make_problem
from exodrake.engine.inputs import NoiseInputs, Reference
from exodrake.simulation import protocols
from exodrake.simulation.simulate import simulate

READING = 1.2e-5  # m, of an encoder


def decoded(robot, log):
    rows = [log.array(kind) for kind in packet_loss.list_needed(robot.machine)]
    return packet_loss.Drive(robot.machine, robot.values, rows, READING).decode()


def test_lost_commands_are_decoded(robot):
    reference = Reference(protocols.random_motion(robot, seed=0).values[:1500], "random")
    deaf = robot.splice("timing.dropped_commands", {"probability": 0.2})
    losses = [decoded(robot, simulate(deaf, reference, seed=seed)) for seed in range(6)]
    _, low, high = packet_loss.loss_probability(losses)
    assert low < 0.2 < high < 0.5
    assert not decoded(robot, simulate(robot, reference, seed=9)).lost.any()


@pytest.mark.parametrize(("enter", "stay"), [(0.3, 0.3), (0.05, 0.7)])
def test_share_of_a_markov_chain_is_covered(enter, stay):
    """Commands lost in runs, of which those are seen that differ from what may be held."""
    rng, covered, true = np.random.default_rng(3), 0, enter / (enter + 1.0 - stay)
    for _ in range(60):
        lost, chance = np.zeros((1500, 1), dtype=bool), rng.random(1500)
        for frame in range(1, 1500):
            lost[frame] = chance[frame] < (stay if lost[frame - 1, 0] else enter)
        steps = np.where(rng.random((1500, 1)) < 0.1, rng.standard_normal((1500, 1)), 0.0)
        _, events, gone = packet_loss.count_visible(np.cumsum(steps, axis=0), lost, np.full((1500, 1), 0.3))
        found = packet_loss.PacketLoss(np.ones((1, 1)), events, gone, np.zeros(2))
        _, low, high = packet_loss.loss_probability([found])
        covered += low < true < high
    assert 0.78 < covered / 60 < 0.99


@pytest.mark.parametrize("effect", ["motor.current_limit", "motor.slow_velocity_loop", "timing.command_latency"])
def test_a_drive_that_follows_badly_loses_no_commands(robot, effect):
    log = CaseLog(simulate(robot.splice(effect), protocols.steps(robot, dwell=0.6), seed=2), "s", "fit", None, "s.csv")
    problem = make_problem(Case("bad", {}, (log,)), robot)
    found = packet_loss.detect(problem, robot.machine.effect("timing.dropped_commands"), problem.silent())
    assert not found.detected and "timing.dropped_commands" not in found.tried


def test_losses_become_inputs_of_the_simulation_and_the_effect_stays_a_candidate(robot):
    """The problem that the detector returns leaves less than the one that it was given, at the robot that loses."""
    reference, deaf = protocols.steps(robot, dwell=0.6), robot.splice("timing.dropped_commands", {"probability": 0.3})
    log = CaseLog(simulate(deaf, reference, seed=1), "steps", "fit", None, "steps.csv")
    problem, effect = make_problem(Case("deaf", {}, (log,)), robot), robot.machine.effect("timing.dropped_commands")
    found = packet_loss.detect(problem, effect, problem.silent())
    (detection,) = found.detected
    assert detection.effect.id == effect.id and not detection.certain and effect.id in found.tried
    lost = found.fit[0].latent[packet_loss.INPUT] == packet_loss.LOST
    assert lost.sum() > 3 and found.counted[effect.id] == detection.effect.parameters["probability"].value
    values = problem.silent(deaf)
    before, after = (np.mean(p.residual(values[None], p.fit) ** 2) for p in (problem, found))
    assert after < 0.5 * before


def test_decoded_losses_are_true_and_what_no_reading_shows_lies_within_the_noise(robot):
    """The bus's own random numbers tell which commands were lost."""
    reference, deaf = protocols.steps(robot, dwell=0.6), robot.splice("timing.dropped_commands", {"probability": 0.15})
    log = CaseLog(simulate(deaf, reference, seed=1), "steps", "fit", None, "steps.csv")
    problem = make_problem(Case("deaf", {}, (log,)), robot)
    found = packet_loss.detect(problem, robot.machine.effect("timing.dropped_commands"), problem.silent())
    arrival = found.fit[0].latent[packet_loss.INPUT]
    truth = NoiseInputs.draw(len(arrival), 1, robot.machine)[packet_loss.INPUT] < 0.15
    assert truth[arrival == packet_loss.LOST].mean() > 0.6 and truth[arrival == packet_loss.ARRIVED].mean() < 0.05
    values = problem.silent(deaf)
    drawn = [written_by(found, values, seed) for seed in range(6)]
    noise = [np.mean(p.residual(values[None], p.fit) ** 2) for p in drawn]
    assert np.mean(noise) > 1.2 and np.mean(found.residual(values[None], found.fit) ** 2) < max(noise)


def test_robot_that_loses_nothing_is_not_tried_for_packet_loss(robot):
    log = CaseLog(simulate(robot, Reference(np.full((200, 3), 0.2)), seed=1), "rest", "fit", None, "rest.csv")
    problem, effect = make_problem(Case("rest", {}, (log,)), robot), robot.machine.effect("timing.dropped_commands")
    found = packet_loss.detect(problem, effect, problem.silent())
    assert effect.id not in found.tried and not found.detected


FREQUENCY = 7.3  # Hz


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
    rng, columns, frame = np.random.default_rng(2), 12, robot.machine.frame
    time = np.arange(2000) * frame
    consistent = [rng.standard_normal((2000, columns)) for _ in range(3)]
    assert not find_peak(consistent, frame).certain
    with_peak = [log + 2.0 * np.sin(2 * np.pi * 6.3 * time + k)[:, None] for k, log in enumerate(consistent)]
    found = find_peak(with_peak, frame)
    assert found.certain and found.frequency == pytest.approx(6.3, abs=0.05)
    assert found.power == pytest.approx(np.full(columns, 2.0), rel=0.2)  # a^2 / 2 of a sine
    assert not find_peak([consistent[0], consistent[1], with_peak[2]], frame).certain  # in one log only: no tremor


@pytest.mark.parametrize(("frequency", "rate"), [(6.3, 0.0), (6.3, 0.5), (6.3, 2.0), (1.6, 0.5)])
def test_rate_of_a_wandering_phase_is_recovered(robot, frequency, rate):
    """Six logs of 60 s: the estimate of a rate of 2 rad^2/s scatters by 10 %."""
    rng, frame = np.random.default_rng(5), robot.machine.frame
    time = np.arange(3000) * frame
    logs = []
    for _ in range(6):
        phase = np.cumsum(np.sqrt(rate * frame) * rng.standard_normal(3000))
        logs.append(
            10.0 * np.sin(2 * np.pi * frequency * time + phase)[:, None] + rng.standard_normal((3000, 2)) * [1.0, 0.1]
        )
    found = phase_rate(logs, Peak(frequency + 0.05, np.array([50.0, 49.0]), 10.0, 1.0), frame)
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
    rng, time = np.random.default_rng(2), np.arange(2000) * robot.machine.frame
    wave = 3.0 * np.sin(2 * np.pi * 0.9 * time + 0.2 * np.cumsum(rng.standard_normal(2000)))[:, None]
    found = find_peak([rng.standard_normal((2000, 12)) + wave for _ in range(3)], robot.machine.frame)
    assert found.prominence > PROMINENT and not found.certain
