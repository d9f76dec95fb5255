"""Packet loss decoded from logs, and robots without it, on which hardly a loss is seen."""

import numpy as np
import pytest

from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.detect import packet_loss
from exodrake.diagnosis.likelihood import written_by
from exodrake.diagnosis.problem import make_problem
from exodrake.engine.inputs import NoiseInputs, Reference
from exodrake.machines.robot_file import load_robot
from exodrake.simulation import protocols
from exodrake.simulation.simulate import simulate

READING = 1.2e-5  # m, of an encoder


@pytest.fixture(scope="module")
def robot():
    return load_robot()


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
