"""Packet loss decoded from logs, and healthy robots, on which no loss is seen."""

from dataclasses import replace

import numpy as np
import pytest
from exodrake.diagnosis.nuisance import coordinates

from exodrake.compiled.inputs import Reference
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.detect import packet_loss
from exodrake.diagnosis.healthy import healthy_case, healthy_robot
from exodrake.diagnosis.problem import make_problem
from exodrake.machines.robot_file import load_robot
from exodrake.simulation import protocols
from exodrake.simulation.simulate import simulate

KINDS = ("speed_cmd", "stroke", "tension")


@pytest.fixture(scope="module")
def robot():
    return load_robot()


def decoded(robot, log):
    return packet_loss.decode(robot.machine, robot.values, {kind: log.array(kind) for kind in KINDS})


def test_lost_commands_are_decoded(robot):
    reference = Reference(protocols.steps(robot, dwell=0.6).tension, "steps")
    deaf = robot.splice("timing.dropped_commands", {"probability": 0.3})
    losses = [decoded(robot, simulate(deaf, reference, seed=seed)) for seed in range(3)]
    _, low, high = packet_loss.loss_probability(losses)
    assert low < 0.3 < high and sum(d.events for d in losses) > 20
    clean = decoded(robot, simulate(robot, reference, seed=9))
    assert clean.lost <= 0.05 * max(clean.events, 1) + 1
    assert packet_loss.evident(losses) and not packet_loss.evident([clean])


def test_commands_lost_in_bursts_are_decoded(robot):
    """A held command repeats in the log what the drive last received: losses of two and three frames in a row."""
    reference = np.concatenate([protocols.random_motion(robot, seed=seed).tension for seed in range(3)])
    rng, packet_arrival = np.random.default_rng(5), np.ones((len(reference), 3))
    for frame in rng.choice(len(reference) - 3, len(reference) // 12, replace=False):
        packet_arrival[frame : frame + rng.integers(2, 4)] = 0.0
    deaf = robot.splice("timing.dropped_commands", {"probability": 0.5})
    short = simulate(robot, Reference(reference[:100]), seed=1)
    problem = make_problem(Case("short", {}, (CaseLog(short, "random", "fit", None, "random.csv"),)), robot)
    lost = packet_loss.PacketLoss(packet_arrival, 0, 0, 0)
    trial = replace(problem.fit[0], reference=reference, losses=lost)
    log = problem.predict(problem.silent(deaf)[None], trial)[0]
    measured = {kind: log[:, [k == kind for k in problem.kinds]] for kind in KINDS}
    found = packet_loss.decode(robot.machine, problem.silent(), measured)
    assert found.certain >= 5 and np.mean(packet_arrival[found.packet_arrival == 0.0] == 0.0) > 0.9


def test_slow_drive_loses_no_command(robot):
    """It follows badly, but no stroke is the held command's."""
    reference = Reference(protocols.steps(robot, dwell=0.6).tension, "steps")
    log = simulate(robot.splice("motor.slow_velocity_loop", {"factor": 0.3}), reference, seed=3)
    assert not packet_loss.evident([decoded(robot, log)])


def test_log_without_commands_and_machine_without_link_have_no_losses(robot):
    log = simulate(robot, Reference(np.ones((20, 3))), seed=0)
    kinds = {kind: log.array(kind) for kind in ("stroke", "tension")}
    assert packet_loss.decode(robot.machine, robot.values, kinds) is None
    so101 = load_robot("so101")
    assert packet_loss.decode(so101.machine, so101.values, kinds) is None


def test_healthy_robots_differ_within_tolerance_and_have_no_effect(robot):
    assert [item.role for item in healthy_case(robot, 5).logs] == ["fit", "fit", "fit", "holdout"]
    drawn = np.array([healthy_robot(robot, np.random.default_rng(seed)).values for seed in range(200)])
    tolerances = coordinates(robot.machine)
    free = sorted(place for t in tolerances for place in t.places)
    assert (np.delete(drawn, free, axis=1) == np.delete(robot.values, free)).all()
    stiffness = next(t for t in tolerances if t.name == "finger.kappa.PIP")
    ratio = drawn[:, stiffness.places[0]] / robot.values[stiffness.places[0]] - 1.0
    assert ratio.std() == pytest.approx(stiffness.prior_std, rel=0.2)
    assert np.abs(ratio).max() <= stiffness.max_deviation
