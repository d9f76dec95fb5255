"""A larger set speaks against a smaller one only where its effects are there; an absent effect is taken out."""

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import FRAMES, case_of, robot_with

from exodrake.diagnosis import fits, isolation, levels
from exodrake.diagnosis.comparison import taken_up
from exodrake.diagnosis.healthy import healthy_robot
from exodrake.diagnosis.isolate import Isolator
from exodrake.diagnosis.part_used import SHARE
from exodrake.diagnosis.pipeline import isolated
from exodrake.diagnosis.problem import make_problem
from exodrake.diagnosis.prune import pruned, spurious
from exodrake.diagnosis.retune import retune
from exodrake.diagnosis.select import NormalMatrix
from exodrake.diagnosis.verdict import decide, rejected
from exodrake.machines.robot_file import load_robot

TRIED = ("tendon.capstan_friction", "mocap.offset", "sensor.drift")


def pairs_of(robot):
    """The isolator of a robot with friction, and the isolation with a second effect beside the friction."""
    problem = make_problem(case_of(robot, 1, FRAMES // 2), load_robot(), frozenset(TRIED)).shortened(2 * SHARE)
    start, simulated = retune(problem)
    isolator = Isolator(problem, start, defaultdict(float, simulated))
    return isolator, isolator.grown(isolator.isolate(1))


@pytest.fixture(scope="module")
def friction():
    return robot_with("tendon.capstan_friction", 1, mu_phi=0.3)


@pytest.fixture(scope="module")
def offset_beside_friction(friction):
    return pairs_of(friction.splice("mocap.offset", {"offset": 0.1}))


def test_directions_beside_a_set_are_simulated_once(friction):
    isolator, larger = pairs_of(friction)
    parent, tests = larger.tested[0][0].explanation, larger.tests
    likelihood = larger.likelihood.scaled_to(parent.residual).for_stage("linearise again")
    before = sum(isolator.simulated.values())
    known = isolator.linearised(likelihood, parent, tests.lin)
    assert sum(isolator.simulated.values()) == before
    isolator.beside.clear()
    fresh = isolator.linearised(likelihood, parent, tests.lin)
    assert sum(isolator.simulated.values()) > before
    assert [p.effect for p in known.probes] == [p.effect for p in fresh.probes]
    np.testing.assert_array_equal(known.directions, fresh.directions)


def test_effects_that_are_not_there_are_not_needed_beside_friction(friction):
    isolator, larger = pairs_of(friction)
    assert larger.left and all(TRIED[0] in t.explanation.effects for t in larger.left)
    assert not isolator.needed(larger)


def test_an_offset_that_is_there_is_needed_beside_friction(offset_beside_friction):
    isolator, larger = offset_beside_friction
    assert larger.left[0].explanation.effects == TRIED[:2] and isolator.needed(larger)
    assert rejected(larger.left[0]).endswith("takes up too little of what a smaller one leaves")


def test_an_effect_of_a_set_grown_before_joins_a_set_without_it(friction):
    isolator, larger = pairs_of(friction)
    (offset,) = (t for t in larger.tested[0] if t.explanation.effects == TRIED[1:2])
    grown = isolator.grown(replace(larger, tested=(*larger.tested, (offset,))))
    assert grown.explanations[0].effects == (TRIED[1], TRIED[0])


def test_an_effect_of_a_rejected_pair_gives_way_to_the_one_that_it_stood_for(offset_beside_friction):
    """Grown from a drift, which is not there, the best pair holds friction beside it; friction and offset are there."""
    isolator, larger = offset_beside_friction
    singles = larger.tested[0]
    (drift,) = (t for t in singles if t.explanation.effects == TRIED[2:])
    grown = isolator.grown(replace(larger, tested=((drift,),)))
    (wrong,) = (t for t in grown.tested[-1] if t.explanation.effects == (TRIED[2], TRIED[0]))
    assert not wrong.levels.kept
    swapped = isolator.swapped(replace(larger, tested=(singles, (wrong,)), left=()))
    assert swapped.left[0].explanation.effects == TRIED[:2] and len(swapped.explanations) == 2
    without_friction = replace(larger, tested=((drift,), (wrong,)), left=())
    assert isolator.swapped(without_friction) is without_friction


def isolation_with_an_offset(robot, offset):
    """An isolation whose retuned robot is stuck at the nominal one, and that keeps an offset fitted beside the true."""
    problem = make_problem(case_of(robot, 1, FRAMES // 2), load_robot(), frozenset(TRIED)).shortened(2 * SHARE)
    start, simulated = retune(problem)
    isolator = Isolator(problem, start, defaultdict(float, simulated))
    found = isolator.isolate(0)
    singles = NormalMatrix(found.likelihood, found.retuned.explanation, found.tests.lin).singles()
    predicted = next(p for p in singles if p.probes[0].effect == TRIED[1])
    (joined, *_) = isolator.fits.starts(found.likelihood, found.retuned.explanation, predicted)
    count = joined.nominal
    x = [p.coordinate(offset) for p in joined.parameters[count:]]
    e = isolator.fits.refined(found.likelihood, joined.at(found.likelihood, np.r_[joined.x[:count], x]), 3)
    (kept,) = isolation.tested(found.likelihood, found.tests, [e])
    return found, replace(found, retuned=found.nominal, tested=((kept,),), left=(kept,))


def test_a_robot_that_needs_no_effect_is_retuned_from_where_an_absent_one_led():
    robot = healthy_robot(load_robot(), np.random.default_rng(3))
    found, stuck = isolation_with_an_offset(robot, 0.0)
    assert stuck.retuned.chi2[0] > 2.0 > found.retuned.chi2[0]
    made = pruned(stuck)
    assert made.left == (made.retuned,) and made.retuned.explanation.effects == ()
    assert made.retuned.chi2 == pytest.approx(found.retuned.chi2, rel=0.05)


def test_an_offset_that_is_there_stays():
    _, stuck = isolation_with_an_offset(load_robot().splice("mocap.offset", {"offset": 0.1}), 0.1)
    assert pruned(stuck) is stuck


def test_directions_beside_a_current_limit_promise_more_of_what_a_gain_takes_up():
    """Beside the retuned robot, whose current is not limited, a load cell of a wrong gain acts otherwise."""
    effects = ("motor.current_limit", "sensor.gain", "mocap.offset")
    gain = {"AF": 0.1, "MF": 0.0, "AE": 0.0}
    robot = robot_with("motor.current_limit", 1, limit=0.05).splice("sensor.gain", {"gain": gain})
    problem = make_problem(case_of(robot, 1), load_robot(), frozenset(effects)).shortened(SHARE)
    start, simulated = retune(problem)
    isolator = Isolator(problem, start, defaultdict(float, simulated))
    found = isolator.isolate(1)
    before, after = (f.tested[0][0] for f in (found, isolator.looked_again(found)))
    assert after.explanation is before.explanation and before.explanation.effects == effects[:1]
    pair = isolator.grown(found).explanations[0]
    assert pair.effects == effects[:2]
    share = taken_up(found.likelihood, before.explanation, pair).share
    assert 1.5 * before.levels.promise < after.levels.promise < share


def test_a_fit_that_leaves_little_is_brought_to_its_minimum_before_another_effect_is_tried():
    """An offset whose nominal parameters stand a little off, so that the rest looks like another effect's; its Jacobian
    is of no use. The same offset beside it that stands as far off comes to the same cost.
    """
    robot = load_robot().splice("mocap.offset", {"offset": 0.1})
    problem = make_problem(case_of(robot, 1, FRAMES // 2), load_robot(), frozenset(TRIED[1:2])).shortened(2 * SHARE)
    start, simulated = retune(problem)
    isolator = Isolator(problem, start, defaultdict(float, simulated))
    found = isolator.isolate(1)
    (true,) = found.explanations
    moves = np.random.default_rng(2).standard_normal((2, len(true.x))) * true.prior_std
    moves[:, true.nominal :] = 0.0
    off = [true.at(found.likelihood, np.clip(true.x + 0.03 * m, *true.bounds)) for m in moves]
    off = [e.with_jacobian(0.0 * true.jacobian) for e in off]
    assert all(0.0 < found.likelihood.mean_log(e.residual) < fits.CONVERGED for e in off)
    stuck = isolation.tested(found.likelihood, found.tests, off)
    settled = isolator.settled(replace(found, tested=(tuple(stuck),), left=tuple(stuck)))
    likelihood = settled.likelihood
    costs = [e.cost(likelihood) for e in (*settled.explanations, true, *off)]
    assert max(costs[:2]) < costs[2] + 0.1 * (min(costs[3:]) - costs[2])


def test_friction_that_the_curvature_calls_absent_is_named_since_the_logs_reject_its_absence(friction, monkeypatch):
    """As beside the threshold of a dead zone, where any width gives the same residual."""

    def flat(tests, e):
        return 1e6 * np.eye(len(e.x) - e.nominal)

    monkeypatch.setattr(levels.Tests, "covariance", flat)
    problem, found = isolated(make_problem(case_of(friction, 1, FRAMES // 2), load_robot(), frozenset(TRIED[:1])))
    (t,) = found.tested[0]
    assert spurious(t, found.fitted(t), ()) == [TRIED[0]] and found.irreducible == (t,)
    assert decide(problem, found).verdict == "NAMED"
