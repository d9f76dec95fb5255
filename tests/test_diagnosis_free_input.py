"""Free inputs: their evidence is that of the normal law, and faults of no known law are found where they act."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import exodrake as exo
from exodrake.compiled.inputs import Reference
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.fit import Explanation
from exodrake.diagnosis.free_input import free_courses
from exodrake.diagnosis.free_input_evidence import CELL, Cells
from exodrake.diagnosis.likelihood import likelihood_of
from exodrake.diagnosis.linearise import linearise
from exodrake.diagnosis.localise import channels_of
from exodrake.diagnosis.parameter import nominal_parameters
from exodrake.diagnosis.problem import make_problem
from exodrake.simulation import protocols


def test_evidence_is_the_density_of_the_normal_law():
    rng, cells, columns, nominal = np.random.default_rng(0), 4, 3, 2
    samples = cells * CELL * columns
    offset, jacobian = 2.0 * rng.standard_normal(samples), rng.standard_normal((nominal, samples))
    responses, prior_std = rng.standard_normal((2, samples)), np.array([0.5, 2.0])
    trial = SimpleNamespace(measured=np.zeros((cells * CELL, columns)))
    model = Cells(offset, jacobian, prior_std, [trial], ["tension", "angle", "angle"], frames=1)
    variance, scale = np.array([1.5, 3.0]), np.array([0.7, 1.9])
    products = model.products(model.cut(responses))
    value = model.solved(products, variance, scale).log_evidence
    within = np.equal.outer(*[np.arange(samples) // (CELL * columns)] * 2)
    covariance = np.diag(np.tile(variance[[0, 1, 1]], cells * CELL)) + (jacobian.T * prior_std**2) @ jacobian
    covariance += within * ((responses.T * scale**2) @ responses)
    wanted = multivariate_normal(np.zeros(samples), covariance).logpdf(offset) + 0.5 * samples * np.log(2.0 * np.pi)
    assert value == pytest.approx(wanted, rel=1e-9)


@pytest.fixture(scope="module")
def robot():
    return exo.load_robot()


def found_in(robot, log, without=""):
    """Problem of one log and the free inputs that it shows, at the nominal robot, without one effect of the library."""
    problem = make_problem(Case("steps", {}, (CaseLog(log, "steps", "fit", None, "steps.csv"),)), robot)
    values, nominal = problem.silent(), nominal_parameters(robot)
    likelihood = likelihood_of(problem, values)
    effects = [effect for effect in robot.machine.effects if not effect.not_tried and effect.id != without]
    lin = linearise(likelihood, values, np.zeros(len(nominal)), nominal, effects)
    start = Explanation((), nominal, lin.x, values, lin.residual, lin.jacobian)
    return problem, free_courses(likelihood, lin, start)


def motion(robot, frames=500):
    """Steps, 10 s."""
    return Reference(protocols.steps(robot, dwell=1.0).values[:frames], "steps")


def spells(frames, height):
    """Two smooth bumps (frames,) of one height."""
    time = np.linspace(0.0, 1.0, frames)
    return height * sum(np.exp(-(((time - middle) / 0.05) ** 2)) for middle in (0.35, 0.75))


@pytest.mark.parametrize(
    "column, height, block, channel, axis",
    [("angle_PIP", 0.15, "mocap", "PIP", "joints"), ("tension_MF", 0.6, "sensor", "MF", "tendons")],
)
def test_spells_in_a_reading_are_found_in_its_sensor_and_channel(robot, column, height, block, channel, axis):
    log = exo.simulate(robot, motion(robot), seed=4)
    wrong = log.signals | {column: log[column] + spells(len(log.time), height)}
    problem, found = found_in(robot, replace(log, signals=wrong))
    assert found[0].block == block
    assert channels_of(problem, found, block, axis) == (channel,)


@pytest.mark.parametrize(
    "injected, block, axis",
    [
        ("tendon.capstan_friction", "tendon", "tendons"),
        ("motor.slow_velocity_loop", "motor", "tendons"),
        ("sensor.hysteresis", "sensor", "tendons"),
    ],
)
def test_fault_that_the_library_lacks_is_found_in_its_block_and_channels(robot, injected, block, axis):
    log = exo.simulate(robot.splice(injected), motion(robot), seed=4)
    problem, found = found_in(robot, log, without=injected)
    assert found[0].block == block and injected not in {course.name for course in found}
    assert channels_of(problem, found, block, axis) == robot.machine.axes.of(axis)
    assert channels_of(problem, found, block, "joints") == ()


def test_log_of_the_nominal_robot_shows_no_free_input(robot):
    _, found = found_in(robot, exo.simulate(robot, motion(robot), seed=4))
    assert not found or found[0].gain < 5.0
