"""Localisation: Shapley shares of segments, affected channels, conditions of a regime."""

from dataclasses import replace

import numpy as np
import pytest

import exodrake as exo
from exodrake.compiled.inputs import Reference
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis import segment_shares
from exodrake.diagnosis.localise import affected, shares_of, sum_by_block
from exodrake.diagnosis.problem import make_problem
from exodrake.diagnosis.regime import conditions, explained, motion, since_reversal
from exodrake.simulation import protocols


@pytest.fixture(scope="module")
def robot():
    return exo.load_robot()


def problem_of(robot, injected, frames=400):
    """Steps of a robot with an injected effect, as the only log."""
    reference = Reference(protocols.steps(robot, dwell=1.0).values[:frames], "steps")
    log = exo.simulate(injected, reference, seed=4)
    return make_problem(Case("steps", {}, (CaseLog(log, "steps", "fit", None, "steps.csv"),)), robot)


def test_shapley_of_an_additive_game_is_the_additive_part():
    accepted = {"motor": 5.0, "tendon": 3.0, "finger": 2.0}
    power = {s: 10.0 - sum(accepted[x] for x in s) for s in segment_shares.subsets(accepted)}
    assert segment_shares.shapley(power) == pytest.approx({"motor": 0.5, "tendon": 0.3, "finger": 0.2})


def test_block_shares_are_those_of_the_airport_game():
    """Littlechild and Owen (1973): the value of a coalition is that of its largest member."""
    gains = {"finger": 0.9, "motor": 0.6, "tendon": 0.3, "sensor": 0.3}
    alone = {"finger.a": 0.9, "finger.b": 0.4, "motor.a": 0.6, "tendon.a": 0.3, "sensor.a": 0.3, "bus.a": 0.0}
    found, steps = shares_of(alone), np.diff([0.0, 0.3, 0.3, 0.6, 0.9])
    wanted = np.cumsum(steps / [4, 3, 2, 1])  # the k-th smallest pays its part of each step up to its own
    order = sorted(gains, key=gains.get)
    assert [found[block] for block in order] == pytest.approx(wanted / 0.9, abs=1e-12)
    assert found["bus"] == pytest.approx(0.0) and sum(found.values()) == pytest.approx(1.0)
    assert next(iter(found)) == "finger"


def test_shares_of_named_effects_add_up_by_block():
    """An effect of unknown share, found by a detector among others, has none."""
    found = sum_by_block([("sensor.a", 0.2), ("tendon.a", 0.6), ("tendon.b", 0.1), ("finger.a", float("nan"))])
    assert found == pytest.approx({"tendon": 0.7, "sensor": 0.2, "finger": 0.0}) and next(iter(found)) == "tendon"


def test_replay_of_nothing_fixed_is_the_prediction(robot):
    problem = problem_of(robot, robot)
    trial = problem.fit[0]
    whole = problem.predict(problem.silent()[None], replace(trial, latent={}))[0]
    np.testing.assert_array_equal(segment_shares.replayed(problem, problem.silent(), trial, ()), whole)


@pytest.mark.parametrize(
    "identity, parameters, segment",
    [("sensor.gain", {"gain": 0.1}, "tendon"), ("finger.stiffness", {"factor": 1.5}, "finger")],
)
def test_segment_of_an_injected_effect_has_the_largest_share_and_replay_gap(robot, identity, parameters, segment):
    problem = problem_of(robot, robot.splice(identity, parameters))
    shares, gaps = segment_shares.segment_gaps(problem, problem.silent(), problem.fit[0])
    assert max(gaps, key=lambda s: gaps[s]) == max(shares, key=lambda s: shares[s]) == segment
    assert sum(shares.values()) == pytest.approx(1.0) and set(shares) == {"motor", "tendon", "finger"}


def test_missing_samples_leave_the_gap_of_a_segment_as_it_is(robot):
    """Two in three samples of the angles are lost, as of a slow camera; the finger is fed with none of them."""
    problem = problem_of(robot, robot.splice("finger.stiffness", {"factor": 1.5}))
    trial, rows = problem.fit[0], np.arange(len(problem.fit[0].measured))
    lost = np.outer(rows % 3 > 0, [kind == "angle" for kind in problem.kinds])
    seen = replace(trial, measured=np.where(lost, np.nan, trial.measured))
    (_, whole), (_, found) = (segment_shares.segment_gaps(problem, problem.silent(), one) for one in (trial, seen))
    assert found["finger"] == pytest.approx(whole["finger"], rel=0.02)
    healthy = segment_shares.own_trial(problem, problem.silent(), seen)
    np.testing.assert_array_equal(np.isnan(healthy.measured), lost)


def test_machine_without_tendons_has_no_affected_tendon(robot):
    so101 = replace(problem_of(robot, robot, 100), robot=exo.load_robot("so101"), columns=("angle_Pitch",))
    assert affected(so101, {"log": np.ones((5, 1))}, "tendons") == ()
    assert affected(so101, {"log": np.ones((5, 1))}, "joints") == ("Pitch",)


def test_condition_that_makes_the_residual_explains_it_and_another_does_not():
    rng = np.random.default_rng(1)
    condition = rng.standard_normal(4000)
    assert explained(np.sign(condition), condition) > 0.9
    assert explained(rng.standard_normal(4000), condition) < 0.02


def test_time_since_reversal():
    assert since_reversal(np.array([1.0, 1.0, -1.0, -1.0, -1.0]), 0.5) == pytest.approx([0.0, 0.5, 0.0, 0.5, 1.0])


def test_conditions_are_those_that_the_machine_declares(robot):
    problem = problem_of(robot, robot)
    trial = problem.fit[0]
    found = conditions(problem, trial, 1)
    np.testing.assert_array_equal(found["load"], trial.measured[:, problem.columns.index("tension_MF")])
    np.testing.assert_array_equal(found["joint angle"], trial.measured[:, problem.columns.index("angle_PIP")])
    np.testing.assert_array_equal(found["slack"], found["load"] < 0.15)
    so101 = exo.load_robot("so101")
    angle = np.linspace(0.0, 1.0, 400)[:, None] ** 2
    plain = replace(problem, robot=so101, columns=("angle_Pitch",))
    found = conditions(plain, replace(trial, measured=angle), 1)
    np.testing.assert_array_equal(found["position"], angle[:, 0])
    assert found["speed"][200] == pytest.approx(2 * (200 / 399) / 399 / so101.machine.frame, rel=0.02)
    assert set(found) == {"direction of motion", "speed", "position", "time since reversal", "time in trial"}


@pytest.mark.parametrize("position", [0.0, 1.5])
def test_direction_of_motion_does_not_depend_on_where_a_joint_is(position):
    """A slow sine about any angle: friction against its motion is explained by the direction."""
    time = 0.02 * np.arange(3000)
    angle, speed = position + 0.1 * np.sin(0.2 * np.pi * time), 0.02 * np.pi * np.cos(0.2 * np.pi * time)
    found = motion(angle, 15, None, 0.02)
    assert np.max(found["speed"]) == pytest.approx(0.02 * np.pi, rel=0.02)
    assert explained(np.sign(speed), found["direction of motion"]) > 0.9
