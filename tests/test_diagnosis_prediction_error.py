"""Prediction-error runs, fed with a log: identities, and a loop that hunts."""

from dataclasses import replace

import numpy as np
import pytest

from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.problem import make_problem
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import load_robot
from exodrake.simulation import protocols
from exodrake.simulation.simulate import simulate

FRAMES = 750  # 15 s a log


@pytest.fixture(scope="module")
def nominal():
    return load_robot()


def case_of(robot, seed, quantisation=True):
    """Holds to fit, steps held out."""
    plan = (("holds", "fit", protocols.holds(robot, seed=3)), ("steps", "holdout", protocols.steps(robot)))
    logs = []
    for k, (name, role, whole) in enumerate(plan):
        reference = Reference(whole.values[:FRAMES], name)
        log = simulate(robot, reference, None if seed is None else seed + k, quantisation)
        logs.append(CaseLog(log, name, role, None, name))
    return Case("fed", {}, tuple(logs))


def chi2(problem, robot):
    """Mean square residual on the fitted logs [noise variances] of a robot."""
    return float(np.mean(problem.residual(problem.silent(robot)[None], problem.fit) ** 2))


def test_a_run_fed_with_its_own_log_is_that_log(nominal):
    problem = make_problem(case_of(nominal, None, quantisation=False), nominal)
    prediction_error = problem.prediction_error()
    kept = [problem.columns.index(c) for c in prediction_error.columns]
    closed = problem.predict(problem.silent()[None], problem.fit[0])[0]
    assert np.array_equal(
        prediction_error.predict(prediction_error.silent()[None], prediction_error.fit[0])[0], closed[:, kept]
    )


def test_the_imposed_column_is_not_judged(nominal):
    problem = make_problem(case_of(nominal, 1), nominal)
    assert set(problem.columns) - set(problem.prediction_error().columns) == {
        f"speed_cmd_{w}" for w in ("AF", "MF", "AE")
    }


def test_a_log_without_commands_cannot_steer(nominal):
    case = case_of(nominal, 1)

    def mute(log):
        return replace(log, signals={k: v for k, v in log.signals.items() if not k.startswith("speed_cmd")})

    logs = tuple(replace(item, log=mute(item.log)) for item in case.logs)
    assert make_problem(replace(case, logs=logs), nominal).prediction_error() is None


@pytest.mark.parametrize(
    ("identity", "parameters"),
    [("sensor.pulley_friction", {"mu": 0.05}), ("motor.dead_zone", {"width": 2.5e-3, "release": 1.0})],
)
def test_noise_in_a_hunting_loop_is_repeated_in_prediction_error(nominal, identity, parameters):
    robot = nominal.splice(identity, parameters)
    problem = make_problem(case_of(robot, 5), nominal)
    left, closed = chi2(problem.prediction_error(), robot) - 1.0, chi2(problem, robot) - 1.0
    assert closed > 1.0  # beside the noise of the sensors, 1, the true robot leaves more than that in closed loop
    assert left < 0.5 * closed  # and prediction errors repeat most of it


def test_an_effect_of_one_part_stays_in_its_part_in_prediction_error(nominal):
    """A slow drive errs in the strokes; the finger, which follows the strokes as measured, hardly feels it."""
    robot = nominal.splice("motor.slow_velocity_loop", {"factor": 0.3})
    closed = make_problem(case_of(robot, 5), nominal)
    prediction_error = closed.prediction_error()

    def excess(problem, kind):
        rows = problem.residual(problem.silent()[None], problem.fit)[0].reshape(-1, len(problem.columns))
        return np.mean(rows[:, [c.startswith(kind) for c in problem.columns]] ** 2) - 1.0

    assert excess(prediction_error, "stroke") > 1.0  # more than the noise
    assert excess(prediction_error, "angle") < 0.5 * excess(closed, "angle")  # most of the angles' error is not theirs
