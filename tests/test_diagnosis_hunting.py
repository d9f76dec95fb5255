"""Noise of robots whose loop hunts: their own independent runs, a quiet robot, and a fault that is none."""

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import case_of, robot_with

from exodrake.core.confidence import ALPHA
from exodrake.diagnosis.comparison import excess, power, taken_up
from exodrake.diagnosis.pipeline import isolated
from exodrake.diagnosis.problem import make_problem
from exodrake.diagnosis.verdict import decide
from exodrake.machines.robot_file import load_robot


def isolation(robot, effect):
    """The problem of a robot's case, and its isolation with one effect tried."""
    return isolated(make_problem(case_of(robot, 1), load_robot(), frozenset([effect])))


def quiet(found):
    """Largest reduced chi-square in closed loop of all draws of the retuned robot's noise, whose loop does not hunt."""
    rows = found.likelihood.split(found.tests.noise.retuned)[0]
    return float(np.max(power(rows))) / rows.shape[-1]


@pytest.fixture(scope="module")
def hunting():
    robot = robot_with("sensor.pulley_friction", 1, mu=0.07)
    return robot, *isolation(robot, "sensor.pulley_friction")


def test_noise_of_a_hunting_robot_is_what_its_independent_runs_leave(hunting):
    """Friction at the pulley: eight other runs of the true robot against its run without noise.

    All eight lie on one side of a level that is right with probability 2^-7.
    """
    robot, problem, found = hunting
    view, left = found.likelihood.views[0], []
    for seed in range(20, 28):
        again = make_problem(case_of(robot, seed), load_robot())
        view = replace(view, problem=replace(again, noise_std=problem.noise_std))
        residual = np.empty((1, view.samples))
        for task in view.tasks(again.silent(robot)[None], residual):
            task()
        left.append(float(np.mean(residual**2)))
    (t,) = found.tested[0]
    assert quiet(found) < min(left) < t.levels.hunting < max(left)


def test_a_hunting_robot_is_named_and_its_reason_says_that_it_hunts(hunting):
    _, problem, found = hunting
    decision, (t,) = decide(problem, found), found.tested[0]
    assert t.chi2[0] > quiet(found) and min(t.levels.views) > ALPHA
    assert decision.verdict == "NAMED" and "its loop hunts" in decision.reasons[-1]


def test_what_noise_leaves_in_a_hunting_loop_is_no_excess(hunting):
    """With the levels of the noise the excess falls by what they say, and to that of the other view at most."""
    *_, found = hunting
    (t,) = found.tested[0]
    likelihood, e = found.likelihood.scaled_to(t.explanation.residual), t.explanation
    levels = found.tests.noise.levels(likelihood, e)
    noise, left = (
        float(np.sum(likelihood.split(rows)[0].astype(float) ** 2))
        for rows in (likelihood.weights, e.residual * likelihood.weights)
    )
    assert levels[0] > 1.0 and left > noise
    fall = min((levels[0] - 1.0) * noise, left - noise)
    assert excess(likelihood, e) - excess(likelihood, e, levels) == pytest.approx(fall, rel=1e-4)
    retuned = found.retuned.explanation
    assert taken_up(likelihood, retuned, e, levels).share > taken_up(likelihood, retuned, e).share > 0.0


def test_what_a_hunting_pair_leaves_by_noise_is_not_held_against_it():
    """Friction at the pulleys, with joints that harden beside it: the pair's own loop is noisier than a quiet one."""
    robot = robot_with("sensor.pulley_friction", 1, mu=0.045)
    robot = robot.splice("finger.hardening", {"coefficient": 0.042})
    tried = frozenset(["finger.hardening", "sensor.pulley_friction"])
    problem, found = isolated(make_problem(case_of(robot, 1), load_robot(), tried))
    decision = decide(problem, found)
    assert decision.verdict == "NAMED" and set(decision.best.explanation.effects) == tried
    single, pair = (size[0].explanation for size in found.tested)
    likelihood, noise = found.likelihood.scaled_to(single.residual), found.tests.noise
    assert noise.levels(likelihood, pair)[0] > quiet(found)
    assert found.share(single, pair) > taken_up(likelihood, single, pair).share


def test_a_fault_of_the_controller_does_not_hunt():
    """A third more proportional gain, which prediction errors do not show, beside a load cell of a wrong gain."""
    gain = {"AF": 0.1, "MF": 0.0, "AE": 0.0}
    robot = robot_with("sensor.gain", 1, gain=gain).with_parameters({"controller.kp": 8e-3})
    problem, found = isolation(robot, "sensor.gain")
    (t,) = found.tested[0]
    assert t.levels.views[-1] > ALPHA > t.levels.views[0]
    assert t.levels.hunting < quiet(found) and decide(problem, found).verdict == "UNKNOWN"


def test_a_quiet_robot_has_the_noise_of_the_retuned_one():
    """Friction in the sheaths, simulated by its own law: no noise of its own is asked for."""
    _, found = isolation(robot_with("tendon.capstan_friction", 1, mu_phi=0.3), "tendon.capstan_friction")
    (t,) = found.tested[0]
    assert t.levels.hunting == 1.0 and not found.tests.noise.own
