"""Slopes, intervals and the judgement of further causes, against closed forms."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from exodrake.diagnosis.fit import Fitter, Point
from exodrake.diagnosis.hypothesis import Hypothesis, hypothesis
from exodrake.diagnosis.larger_sets import predicts_better
from exodrake.diagnosis.retune import CLOSE
from exodrake.diagnosis.search import Fitted, Ranking

from exodrake.compiled.inputs import Reference
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.intervals import interval, spread
from exodrake.diagnosis.problem import make_problem
from exodrake.diagnosis.verdict import thresholds
from exodrake.machines.robot_file import load_robot
from exodrake.simulation import protocols
from exodrake.simulation.simulate import simulate


@pytest.fixture(scope="module")
def robot():
    return load_robot()


@pytest.fixture(scope="module")
def problem(robot):
    """8 s of holds to fit, 8 s of steps held out, of a robot with a softer PIP."""
    planted = robot.splice("finger.stiffness", {"factor": 1.3}, ("PIP",))
    plan = (("holds", "fit", protocols.holds(robot, seed=3)), ("steps", "holdout", protocols.steps(robot)))
    logs = [
        CaseLog(simulate(planted, Reference(r.tension[:400], n), seed=k), n, role, None, n)
        for k, (n, role, r) in enumerate(plan)
    ]
    return make_problem(Case("numbers", {}, tuple(logs)), robot)


@pytest.mark.parametrize("central", [False, True])
def test_slope_of_a_marker_gain_is_the_angle(robot, problem, central):
    """q as seen = (1 + gain) q, and nothing else sees the marker: d residual / d gain = -q / floor."""
    fitter, h = Fitter(problem), hypothesis(robot.machine, robot.machine.effect("mocap.gain"), ("PIP",))
    point = fitter.at(h, np.zeros(1), np.zeros(len(fitter.coordinates)))
    slopes = fitter.slopes(point, central)[:, 0].reshape(-1, len(problem.columns))
    at = problem.columns.index("angle_PIP")
    angle = problem.predict(problem.silent()[None], problem.fit[0])[0][:, at]
    assert slopes[:, at] == pytest.approx(-angle / problem.noise_std[at], abs=1e-6 * np.abs(slopes[:, at]).max())
    assert np.abs(np.delete(slopes, at, axis=1)).max() < 1e-9 * np.abs(slopes).max()


def test_a_polished_fit_is_where_the_cost_stands_still(robot, problem):
    """The planted factor, among nominal numbers that are right: what is found lies by the truth, prior and all."""
    ranking, h = Ranking(problem), hypothesis(robot.machine, robot.machine.effect("finger.stiffness"))
    rough = ranking.complete(ranking.full.at(h, 0.5 * h.start, ranking.origin.x))
    found = ranking.converged(rough)
    assert found.point.cost < rough.point.cost
    again, _ = ranking.full.minimised(found.point)
    assert found.point.cost - again.cost < 0.5  # half a unit of log-likelihood
    factors = [k.value(u) for k, u in zip(h.coordinates, found.point.u, strict=True)]
    assert factors == pytest.approx([1.0, 1.3, 1.0], abs=0.12)  # kappa's own 3 % is a valley of that length


def test_retuned_numbers_near_the_floor_are_settled(robot):
    """What a fit that stopped early leaves would pass for an effect."""
    softer = robot.with_parameters({"finger.kappa.PIP": 1.06 * robot["finger.kappa.PIP"]})
    log = simulate(softer, Reference(protocols.holds(robot, seed=3).tension[:400], "holds"), seed=1)
    problem = make_problem(Case("softer", {}, (CaseLog(log, "holds", "fit", None, "holds"),)), robot)
    point = Ranking(problem).retuned().point
    again, _ = Fitter(problem).minimised(point)
    assert point.chi2 < CLOSE and point.cost - again.cost < 0.5


def test_the_most_promising_start_is_fitted_to_the_end():
    """However badly its first two steps went: a stiffening wire starts far off and ends at the floor."""
    after = {"promising": (400.0, 1.0), "b": (9.0, 8.0), "c": (10.0, 9.0), "d": (11.0, 10.0)}

    def at(name, chi2):
        residual = np.full(10, np.sqrt(chi2))
        return Point(Hypothesis((name,), ()), np.zeros(0), np.zeros(0), residual, 5.0 * chi2)

    def fit(point, responses, steps, gram):
        return at(point.hypothesis.name, after[point.hypothesis.name][steps > 2])

    ranking = Ranking.__new__(Ranking)
    ranking.progress, ranking.quick, ranking.started = (lambda *_: None), SimpleNamespace(fit=fit), lambda start: start
    found = ranking.race([at(name, 1e3) for name in after], np.zeros((10, 0)), np.zeros((0, 0)), finalists=1)
    assert [(p.hypothesis.name, round(p.chi2, 9)) for p in found] == [
        ("promising", 1.0), ("b", 8.0), ("c", 10.0), ("d", 11.0),
    ]  # fmt: skip


def test_an_interval_is_that_of_so_many_frames_as_one(robot, problem):
    """One gain, the nominal numbers held: variance = frames / sum (q / floor)^2 at a misfit of 1."""
    h = hypothesis(robot.machine, robot.machine.effect("mocap.gain"), ("PIP",))
    fitter = Fitter(problem, memory=25.0 * robot.machine.frame)
    point = fitter.at(h, np.zeros(1), np.zeros(len(fitter.coordinates)))
    point = replace(point, residual=point.residual / np.sqrt(point.chi2))
    found = spread(fitter, point, np.zeros((len(point.residual), len(fitter.coordinates))))
    slopes = fitter.slopes(point, central=True)[:, 0]
    assert found.deviations[0] == pytest.approx(np.sqrt(25.0 / np.sum(slopes**2)), rel=1e-6)


def test_numbers_are_held_near_where_they_usually_are(robot, problem):
    """A marker offset and a rest angle that errs by three deviations leave nearly the same log; the longer the
    piece of log that counts as one frame, the less does the angle take.
    """
    h = hypothesis(robot.machine, robot.machine.effect("mocap.offset"))
    strains = []
    for memory in (0.02, 0.66, 1e4):
        fitter = Fitter(problem, memory)
        point, _ = fitter.minimised(fitter.at(h, np.zeros(3), np.zeros(len(fitter.coordinates))))
        strains.append(fitter.nuisance_chi2(point))
    assert strains[0] > strains[1] > strains[2] and strains[2] < 0.01


def test_a_pitch_is_told_near_palm_down_or_palm_up(robot):
    coordinate = next(k for k in hypothesis(robot.machine, robot.machine.effect("finger.gravity")).coordinates)
    for told, fitted in ((-0.2, -0.2), (3.3, 3.3 - 2 * np.pi), (3.0, 3.0)):
        found = interval(coordinate, coordinate.at(fitted), 0.01)
        assert found.value == pytest.approx(told) and found.low < told < found.high


def test_an_undetermined_number_ends_at_its_range(robot):
    coordinate = next(
        k for k in hypothesis(robot.machine, robot.machine.effect("tendon.creep")).coordinates if not k.first
    )
    assert coordinate.number.transform == "log"
    known = interval(coordinate, coordinate.start, 0.01)
    lost = interval(coordinate, coordinate.start, 1e4)
    assert known.low < coordinate.value(coordinate.start) < known.high
    assert [lost.low, lost.high] == pytest.approx([coordinate.value(b) for b in coordinate.bounds])


def test_a_further_cause_counts_where_it_predicts_a_signal_better(robot, problem):
    before = Ranking(problem).nominal()
    loudest = int(np.argmax(np.mean(before.held.reshape(-1, len(problem.columns)) ** 2, axis=0)))

    def quieter(residual, factor):
        rows = residual.reshape(-1, len(problem.columns)).copy()
        rows[:, loudest] *= factor
        return rows.ravel()

    def tried(fitted, held):
        point = replace(before.point, residual=quieter(before.point.residual, fitted))
        return Fitted(point, quieter(before.held, held))

    assert predicts_better(problem, tried(0.7, 0.9), before, thresholds())
    assert not predicts_better(problem, tried(0.7, 1.0), before, thresholds())  # learnt by heart
    assert not predicts_better(problem, tried(0.97, 0.97), before, thresholds())
    assert not predicts_better(problem, before, before, thresholds())
