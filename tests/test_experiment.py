"""The next experiment: what a motion tells, what is safe, and the search."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from arm_folders import made as new_machine
from command_line import run
from effects_motion import motion_of
from scipy.stats import norm

import exodrake as exo
from exodrake.core.errors import InputError
from exodrake.core.plain import plain
from exodrake.data.case import Case, CaseLog, read_case, write_case
from exodrake.diagnosis.problem import list_required, make_problem
from exodrake.diagnosis.result import Rival, record_provenance
from exodrake.diagnosis.search import LAW, NATS
from exodrake.engine.inputs import Reference
from exodrake.experiment import contest as inside, design as search
from exodrake.experiment.contest import UNSURE, Information, information, pair_model, prepare_contest, refit
from exodrake.experiment.design import Stage, check_length, design, measure_safety
from exodrake.simulation.protocols import from_log

VISCOUS = Rival(("carriage.viscous_friction",), {"carriage.viscous_friction.coefficient": 150.0})
COULOMB = Rival(("carriage.coulomb_friction",), {"carriage.coulomb_friction.force": 15.0})


def case_of(robot):
    """A carriage with viscous friction, and one short motion."""
    log = exo.simulate(robot, exo.Reference(motion_of("emps", 1)), seed=1)
    return Case("emps", {}, (CaseLog(log, "motion", "fit", None, "motion.csv"),), robot.machine.frame)


@pytest.fixture(scope="module")
def problem():
    robot = exo.load_robot("emps")
    worn = robot.splice("carriage.viscous_friction", {"coefficient": 150.0})
    return make_problem(case_of(worn), robot)


@pytest.fixture(scope="module")
def contest(problem):
    return prepare_contest(problem, [VISCOUS, COULOMB])


@pytest.fixture(scope="module")
def few():
    """A short search."""
    with pytest.MonkeyPatch.context() as patch:
        for name, count in (("RANDOM", 3), ("WINDOWS", 2), ("MUTATIONS", 1), ("WHOLE", 1)):
            patch.setattr(search, name, count)
        patch.setattr(inside, "DRAWS", 3)
        yield


@pytest.fixture(scope="module")
def made(contest, few):
    """A designed experiment."""
    return design(contest, 20.0, 1)


def left(difference, columns, weights):
    """T of a pair."""
    return pair_model(difference, columns, weights).posterior().cost


def test_what_a_refitted_rival_leaves_is_that_of_two_linear_models_by_hand():
    """True a s^2 against b s at s = 0, 1, 2, b known to 1: d = (0, 1, 4), J = (0, 1, 2), J'd = 9, J'J = 5.

    T = 17 - 81 / 6; without the prior, least squares leaves 17 - 81 / 5.
    """
    d, line = np.array([0.0, 1.0, 4.0]), np.array([[0.0, 1.0, 2.0]])
    assert left(d, line, np.ones(3)) == pytest.approx(17.0 - 81.0 / 6.0)
    assert left(d, 1e6 * line, np.ones(3)) == pytest.approx(17.0 - 81.0 / 5.0)
    assert left(d, line, np.full(3, 0.25)) == pytest.approx(17.0 / 4.0 - (81.0 / 16.0) / (1.0 + 5.0 / 4.0))


def test_probability_is_that_of_a_normal_law_beyond_what_evidence_and_laws_ask_for():
    """T = 64. Evidence asks for sqrt(2 NATS); laws that err by 0.2 in what takes up 900 for sqrt T = 6."""
    pair = pair_model(np.full(4, 4.0), np.zeros((1, 4)), np.ones(4))
    for error, law in ((0.0, 0.0), (LAW, LAW * 30.0)):
        contest = SimpleNamespace(error=np.full(2, error), taken=np.zeros(2))
        found = Information({(0, 1): pair, (1, 0): pair}, np.full(2, 900.0), contest)
        wanted = (8.0 - max(np.sqrt(2.0 * NATS), law)) / np.hypot(1.0, UNSURE * law)
        assert found.probability == pytest.approx(norm.cdf(wanted))
        both = found + found
        assert both.left[0, 1] == pytest.approx(128.0) and both.taken == pytest.approx([1800.0, 1800.0])


def test_frames_that_no_linearisation_describes_count_little(contest, problem, monkeypatch):
    """Where drawn robots miss the linearisation by 10 standard deviations of noise, variances are 200 larger."""
    reference = problem.fit[0].reference
    variance = max(contest.chi2[0], 1.0)

    def square(missed):
        monkeypatch.setattr(inside, "nonlinearity", lambda *args: missed)
        return information(contest, reference).models[0, 1].products[0, -1, -1]

    none = np.zeros(len(reference) * len(problem.columns))
    first = np.where(np.arange(len(none)) < len(none) // 2, 100.0, 0.0)
    assert square(none + 100.0) == pytest.approx(square(none) * variance / (variance + 200.0))
    assert square(none + 100.0) < square(first) < square(none)


def test_a_law_with_another_value_is_no_rival_once_it_is_refitted(problem):
    """The same law with a coefficient of 300 instead of 150: refitted it leaves no evidence against it."""
    twice = Rival(VISCOUS.effects, {"carriage.viscous_friction.coefficient": 300.0})
    contest = prepare_contest(problem, [VISCOUS, twice])
    found = refit(contest, problem.fit[0].reference)
    assert found.left[0, 1] < 2.0 * NATS
    e = contest.explanations[1]
    k = next(k for k, p in enumerate(e.parameters) if p.effect)
    assert found.refit(0, 1)[k] == pytest.approx(150.0, rel=0.2)


def test_the_error_of_a_wrong_law_is_larger_than_that_of_the_true_one(contest):
    true, wrong = contest.error
    assert wrong > 3.0 * true and wrong <= LAW


def test_another_speed_tells_viscous_from_coulomb_friction_the_same_speed_does_not(contest):
    """At one constant speed v a viscous force c v is a Coulomb force; at other speeds it is not."""
    stage = Stage(contest.problem.robot, contest.problem.fit)
    s = np.linspace(0.0, 1.0, 8001)[:, None]
    one, two = 0.2 + 0.6 * s, np.where(s < 0.5, 0.2 + 0.2 * s, 0.3 + (s - 0.5))
    both = [information(contest, stage.reference(shares).values) for shares in (one, two)]
    assert both[0] is not None and both[1] is not None
    assert both[1].left[0, 1] > 3.0 * both[0].left[0, 1]


def test_rates_among_the_inputs_are_those_of_the_motion(arm_folder):
    """Of inverse dynamics velocity and acceleration are inputs beside the position."""
    robot = new_machine(arm_folder, "rates", "--urdf", "cable_arm")
    joints = len(robot.machine.axes.joints)
    course = np.repeat(0.3 * np.sin(np.linspace(0.0, 9.0, 900))[:, None], 3 * joints, axis=1)
    stage = Stage(robot, (SimpleNamespace(reference=course),))
    moved = stage.reference(0.5 + 0.1 * np.sin(np.linspace(0.0, 3.0, 900))[:, None] * np.ones(joints)).values
    position, velocity, acceleration = np.split(moved, 3, axis=1)
    assert np.ptp(position, axis=0).min() > 0.1
    for rate, of in ((velocity, position), (acceleration, velocity)):
        assert rate == pytest.approx(np.gradient(of, robot.machine.frame, axis=0))


def test_motion_beyond_a_limit_is_not_safe(contest):
    """The same motion with the range of the position set just below its peak, and with its rate."""
    safety = measure_safety(contest.problem, contest.robots, [])
    records = contest.records(Reference(contest.problem.fit[0].reference))
    k = safety.machine.offsets["position_read"].start
    here, peak = np.arange(len(safety.high)) == k, records[:, :, k].max()
    assert safety.allows(records)
    assert not replace(safety, high=np.where(here, peak - 1e-6, safety.high)).allows(records)
    assert not replace(safety, rate=np.where(here, 1e-9, safety.rate)).allows(records)
    (_, unit, reached, allowed), *_ = [s for s in safety.spans(records) if s[0] == "position_read_carriage"]
    assert unit == "m" and reached[1] == peak and allowed == pytest.approx([safety.low[k], safety.high[k]])


def test_search_is_seeded_and_safe(contest, made, few):
    assert np.array_equal(made.reference.values, design(contest, 20.0, 1).reference.values)
    assert made.safety.allows(contest.records(made.reference))
    low, high = contest.problem.robot.reference_limits()
    course = made.reference.values[:, :1]
    assert (course >= low).all() and (course <= high).all()


def test_designed_motion_tells_rivals_apart_better_than_a_sine_of_its_size(contest, made):
    course, stage = made.reference.values[:, :1], Stage(contest.problem.robot, contest.problem.fit)
    wave = 0.5 * (1.0 - np.cos(np.linspace(0.0, 40.0 * np.pi, len(course))))[:, None]
    shares = (course.min() + np.ptp(course) * wave - stage.low) / (stage.high - stage.low)
    sine = refit(contest, stage.reference(shares).values)
    assert made.information.criterion > sine.criterion


def test_search_refuses_what_no_limit_allows(contest, few, monkeypatch):
    closed = measure_safety(contest.problem, contest.robots, [])
    shut = replace(closed, high=np.full_like(closed.high, -1e3))
    monkeypatch.setattr(search, "measure_safety", lambda *_: shut)
    with pytest.raises(InputError, match="no motion is safe"):
        design(contest, 20.0)


@pytest.mark.parametrize("duration", [5.0, 61.0])
def test_length_out_of_range_is_refused(duration):
    robot = exo.load_robot("emps")
    with pytest.raises(InputError, match="wanted 20 to 60 s"):
        check_length(robot, duration)
    slow = replace(robot, machine=replace(robot.machine, frame=1.0))
    assert check_length(slow, None) == check_length(slow, 120.0) == 120


def test_log_of_an_experiment_is_used_in_full_length(problem):
    log = problem.case.logs[0]
    case = replace(problem.case, logs=(log, replace(log, protocol="experiment", file="experiment.csv")))
    short = make_problem(case, problem.robot).shorten(0.35)
    whole = len(log.log)
    assert [len(trial.reference) for trial in short.fit] == [int(0.35 * whole), whole]


@pytest.fixture(scope="module")
def answered(problem, tmp_path_factory):
    """A case folder with an ambiguous answer."""
    folder = tmp_path_factory.mktemp("case")
    write_case(problem.case, folder)
    case = read_case(folder, list_required(problem.robot.machine), problem.robot.machine.frame)
    made = record_provenance(make_problem(case, problem.robot))
    answer = {"verdict": "AMBIGUOUS", "rivals": plain([VISCOUS, COULOMB]), "provenance": plain(made)}
    (folder / "diagnosis.json").write_text(json.dumps(answer))
    return folder


def test_command_writes_a_reference_that_a_robot_follows(answered, few, tmp_path):
    out = tmp_path / "reference.csv"
    result = run("experiment", answered, "--robot", "emps", "--out", out, "--duration", 20)
    assert result.exit_code == 0, result.output
    assert "carriage.coulomb_friction" in result.output and "diagnose again" in result.output
    robot = exo.load_robot("emps")
    reference = from_log(out, robot)
    assert len(reference.values) == pytest.approx(20.0 / robot.machine.frame, rel=1e-3)
    assert "position_ref_carriage [m]" in out.read_text().splitlines()[0]
    assert out.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    again = tmp_path / "again.csv"
    result = run("experiment", answered / "diagnosis.json", "--robot", "emps", "--out", again, "--duration", 20)
    assert result.exit_code == 0 and again.read_bytes() == out.read_bytes()


def test_command_says_why_there_is_nothing_to_do(answered, tmp_path):
    result = run("experiment", answered, "--case", answered, "--robot", "emps", "--out", tmp_path / "reference.csv")
    assert result.exit_code == 2 and "is a case itself" in result.output
    answer = json.loads((answered / "diagnosis.json").read_text())
    for changes, status, words in (
        ({"verdict": "NAMED", "rivals": []}, 0, "one explanation is left"),
        ({"rivals": 3}, 2, "rivals"),
        ({"provenance": answer["provenance"] | {"files": {}}}, 2, "other logs"),
        ({"provenance": answer["provenance"] | {"parameters": "0"}}, 2, "another nominal robot"),
        ({"rivals": [{"effects": [], "parameters": {"no.such": 1.0}}] * 2}, 2, "no parameter 'no.such'"),
    ):
        path = tmp_path / "answer.json"
        path.write_text(json.dumps(answer | changes))
        out = tmp_path / "reference.csv"
        result = run("experiment", path, "--case", answered, "--robot", "emps", "--out", out)
        assert result.exit_code == status and words in result.output, result.output
        assert not out.exists()
