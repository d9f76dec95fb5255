"""The next experiment: it is the one of the menu in which rivals differ most, if they do at all."""

import numpy as np
import pytest
from effects_motion import motion_of

import exodrake as exo
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.experiment import menu, next_experiment
from exodrake.diagnosis.problem import make_problem


@pytest.fixture(scope="module")
def problem():
    """A carriage, whose machine declares no experiments."""
    robot = exo.load_robot("emps")
    log = exo.simulate(robot, exo.Reference(motion_of("emps", 1)), seed=1)
    return make_problem(
        Case("emps", {}, (CaseLog(log, "motion", "fit", None, "motion.csv"),), robot.machine.frame), robot
    )


def rows_of(problem, *robots):
    return np.array([problem.silent(robot) for robot in robots])


def test_viscous_and_coulomb_friction_are_told_apart_by_another_speed(problem):
    """One viscous and one Coulomb friction: at twice the speed the one doubles and the other does not."""
    robot = problem.robot
    rivals = rows_of(
        problem,
        robot.splice("carriage.viscous_friction", {"coefficient": 150.0}),
        robot.splice("carriage.coulomb_friction", {"force": 15.0}),
    )
    found = next_experiment(problem, rivals, ["viscous", "coulomb"])
    assert found["protocol"] == "the same motion, twice as fast" and found["enough"]
    assert found["between"] == ["viscous", "coulomb"] and found["difference_in_floors"] > 1.0
    frames = len(problem.fit[0].reference) // 2
    assert found["seconds"] == pytest.approx(frames * robot.machine.frame, abs=robot.machine.frame)


def test_rivals_that_no_motion_separates_need_another_measurement(problem):
    found = next_experiment(problem, rows_of(problem, problem.robot, problem.robot), ["a", "b"])
    assert found["difference_in_floors"] == 0.0 and not found["enough"] and "known state" in found["advice"]


def test_machine_that_declares_experiments_is_asked_for_those():
    robot = exo.load_robot()
    log = exo.simulate(robot, exo.Reference(exo.steps(robot).tension[:120]), seed=1)
    problem = make_problem(Case("steps", {}, (CaseLog(log, "steps", "fit", None, "steps.csv"),)), robot)
    assert list(menu(problem)) == list(robot.machine.experiments)
