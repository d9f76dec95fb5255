"""Several causes in one case: beside a tremor, beside another law, and runs that diverge on the way."""

from types import SimpleNamespace

import numpy as np
import pytest
from exodrake.diagnosis.fit import Point
from exodrake.diagnosis.hypothesis import Hypothesis
from exodrake.diagnosis.search import PACKET_LOSS, Fitted
from exodrake.diagnosis.second_effects import accepted, clearly_best, once

from exodrake.compiled.inputs import Reference
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis import filters
from exodrake.diagnosis.pipeline import diagnose
from exodrake.diagnosis.problem import WILD, make_problem
from exodrake.diagnosis.verdict import thresholds
from exodrake.machines.robot_file import load_robot
from exodrake.simulation import protocols
from exodrake.simulation.simulate import simulate

PERIOD = 0.02
SAMPLES = 20_000


def case_of(robot, frames=1200):
    """Two random motions to fit, steps held out."""
    logs = []
    for seed, role in enumerate(("fit", "fit", "holdout")):
        whole = protocols.steps(robot) if role == "holdout" else protocols.random_motion(robot, seed=seed)
        log = simulate(robot, Reference(whole.tension[:frames], role), seed=seed)
        logs.append(CaseLog(log, f"log {seed}", role, None, f"{seed}.csv"))
    return Case("several", {}, tuple(logs))


@pytest.fixture(scope="module")
def robot():
    return load_robot()


@pytest.mark.parametrize("frequency, left", [(2.0, 1.0), (7.0, 0.0), (12.0, 1.0)])
def test_a_stopped_band_takes_what_is_in_it_and_nothing_else(frequency, left):
    time = PERIOD * np.arange(4000)
    wave = np.sin(2 * np.pi * frequency * time)[None, :, None]
    kept = filters.without(((6.0, 8.0),), wave, PERIOD)
    power = np.mean(kept[0, 200:-200, 0] ** 2)
    assert power == pytest.approx(0.5 * left / (1.0 - 2.0 * 2.0 * PERIOD), abs=0.05)  # white noise keeps its power


def test_white_noise_keeps_its_power_without_a_band():
    noise = np.random.default_rng(4).standard_normal((1, 60_000, 2))
    left = filters.without(((4.0, 6.4), (9.0, 11.4)), noise, PERIOD)
    assert np.mean(left**2) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("frequency, strength, left", [(7.0, 1.0, 0.0), (7.0, 0.6, 0.4), (2.0, 1.0, np.sqrt(2.0))])
def test_in_the_band_of_a_tremor_only_its_strength_counts(frequency, strength, left):
    """A quarter turn out of phase: sin - cos has sqrt(2) the amplitude of either."""
    time = PERIOD * np.arange(4000)
    measured = np.sin(2 * np.pi * frequency * time)[:, None]
    simulated = strength * np.cos(2 * np.pi * frequency * time)[:, None]
    gap = filters.mismatch(measured, simulated, ((6.0, 8.0),), PERIOD)
    assert np.sqrt(np.mean(gap[200:-200] ** 2)) == pytest.approx(left * np.sqrt(0.5), abs=0.02)


def test_a_run_that_divides_by_zero_is_bad_not_fatal(robot):
    problem = make_problem(case_of(robot, frames=200), robot)
    broken = problem.silent()
    broken[robot.machine.index["motor.r_set"]] = 0.0  # speed references are divided by it
    residual = problem.residual(np.array([problem.silent(), broken]), problem.fit)
    assert np.isfinite(residual).all()
    assert np.mean(residual[0] ** 2) < 2.0
    assert np.mean(np.abs(residual[1]) == WILD) > 0.1


def fitted(chi2, *effects):
    """A candidate that leaves so much [floor^2] in every sample."""
    residual = np.full(SAMPLES, np.sqrt(chi2))
    point = Point(Hypothesis(effects, ()), np.zeros(0), np.zeros(0), residual, 0.5 * SAMPLES * chi2)
    return Fitted(point, residual)


@pytest.mark.parametrize(
    "first, seconds, kept",
    [
        (400.0, (150.0, 160.0), 2),  # much is left: half of it is enough
        (400.0, (250.0, 390.0), 0),
        (11.0, (6.0, 11.0), 1),  # as another law may: the second stands alone
        (11.0, (6.0, 6.5), 0),  # what a law leaves, both take up
        (11.0, (3.0, 3.1), 2),  # nearly all of it
        (11.0, (8.0, 30.0), 0),
        (1.4, (1.35, 1.4), 0),  # near the floor the cost must fall by much
        (1.4, (1.2, 1.4), 1),
        (1.4, (1.2, 1.25), 0),  # and by more than beside an effect of another block
    ],
)
def test_a_second_effect_must_be_worth_it(first, seconds, kept):
    problem, retuned = SimpleNamespace(columns=("angle_MCP",)), fitted(1001.0)
    pairs = [fitted(chi2, "a", str(k)) for k, chi2 in enumerate(seconds)]
    found = accepted(problem, fitted(first, "a"), pairs, retuned, thresholds())
    assert found == pairs[:kept]


def test_what_is_left_beside_lost_commands_is_judged_by_cost():
    """Most of it are losses that nobody saw, so that no second effect removes half."""
    problem, retuned = SimpleNamespace(columns=("angle_MCP",)), fitted(75.0)
    first, pair = fitted(39.0, PACKET_LOSS), fitted(32.0, PACKET_LOSS, "sensor.crosstalk")
    other = fitted(38.0, PACKET_LOSS, "motor.slow_velocity_loop")
    assert accepted(problem, first, [pair, other], retuned, thresholds()) == [pair]
    assert accepted(problem, fitted(39.0, "a"), [fitted(32.0, "a", "b")], retuned, thresholds()) == []


def test_far_better_is_said_of_other_blocks_only():
    """Two names of one block may be two words for one thing."""
    before, best = fitted(1.7), fitted(1.4, "timing.mocap_delay")
    assert clearly_best(
        before, [best, fitted(1.41, "timing.mocap_clock_skew"), fitted(1.7, "mocap.gain")], thresholds()
    )
    assert not clearly_best(before, [best, fitted(1.5, "mocap.gain")], thresholds())


def test_a_pair_counts_once_in_whatever_order():
    worse, better = fitted(3.0, "a", "b"), fitted(2.0, "b", "a")
    assert once([worse, fitted(4.0, "a", "c"), better])[0] is better
    assert len(once([worse, better])) == 1


def test_the_cause_beside_a_tremor_is_named(robot):
    shaken = robot.splice("finger.tremor", {"torque": 4e-3, "frequency": 7.3}, channels=["MCP"])
    found = diagnose(case_of(shaken.splice("mocap.gain", {"gain": 0.15}, channels=["PIP"])), robot)
    named = {effect.id: effect for effect in found.effects}
    assert found.verdict == "NAMED" and set(named) == {"finger.tremor", "mocap.gain"}
    assert named["finger.tremor"].parameters["frequency"].value == pytest.approx(7.3, abs=0.1)
    assert named["finger.tremor"].joints == ("MCP",) and named["mocap.gain"].joints == ("PIP",)


def test_a_tremor_alone_is_named_alone(robot):
    shaken = robot.splice("finger.tremor", {"torque": 4e-3, "frequency": 5.1}, channels=["PIP"])
    found = diagnose(case_of(shaken), robot)
    assert [effect.id for effect in found.effects] == ["finger.tremor"]
