"""The next experiment: what a motion tells, what is safe, and the search."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import run
from effects_motion import motion_of
from scipy.stats import norm

import exodrake as exo
from exodrake.compiled.inputs import Reference
from exodrake.core.errors import InputError
from exodrake.core.plain import plain
from exodrake.data.case import Case, CaseLog, read_case, write_case
from exodrake.diagnosis.calibration import calibration_of
from exodrake.diagnosis.comparison import contributions
from exodrake.diagnosis.parameter import apply
from exodrake.diagnosis.problem import make_problem, required_of
from exodrake.diagnosis.provenance import provenance_of
from exodrake.diagnosis.rival import Rival
from exodrake.diagnosis.stuck import from_another_law
from exodrake.experiment import design as search, terms as inside
from exodrake.experiment.contest import Laws, contest_of, contributed
from exodrake.experiment.design import design
from exodrake.experiment.figure import difference_of
from exodrake.experiment.information import CHANCE, UNSURE, Information, information, pair_of
from exodrake.experiment.length import frames_of
from exodrake.experiment.motif import random_motif
from exodrake.experiment.refit import refitted
from exodrake.experiment.safety import safety_of
from exodrake.experiment.stage import limited, stage_of
from exodrake.experiment.terms import trial_of
from exodrake.simulation.references import from_log
from studies.experiment_page import page

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
    return contest_of(problem, [VISCOUS, COULOMB])


@pytest.fixture
def few(monkeypatch):
    """A short search."""
    for name, count in (("RANDOM", 5), ("WINDOWS", 3), ("MUTATIONS", 4)):
        monkeypatch.setattr(search, name, count)


def test_what_a_refitted_rival_leaves_is_that_of_two_linear_models_by_hand():
    """True a s^2 against b s at s = 0, 1, 2, b known to 1: d = (0, 1, 4), J = (0, 1, 2), J'd = 9, J'J = 5.

    T = 17 - 81 / 6; without the prior, least squares leaves 17 - 81 / 5.
    """
    d, line = np.array([0.0, 1.0, 4.0]), np.array([[0.0, 1.0, 2.0]])
    assert pair_of(d, line, np.ones(3)).left == pytest.approx(17.0 - 81.0 / 6.0)
    assert pair_of(d, 1e6 * line, np.ones(3)).left == pytest.approx(17.0 - 81.0 / 5.0)
    assert pair_of(d, line, np.full(3, 0.25)).left == pytest.approx(17.0 / 4.0 - (81.0 / 16.0) / (1.0 + 5.0 / 4.0))


def test_information_adds_over_motions():
    rng = np.random.default_rng(3)
    d, columns, weights = rng.normal(size=20), rng.normal(size=(4, 20)), rng.uniform(0.2, 1.0, 20)
    parts = [pair_of(d[k], columns[:, k], weights[k]) for k in (slice(0, 8), slice(8, 20))]
    assert (parts[0] + parts[1]).left == pytest.approx(pair_of(d, columns, weights).left)
    stacked = np.vstack([np.sqrt(weights)[:, None] * columns.T, np.eye(4)])
    target = np.concatenate([np.sqrt(weights) * d, np.zeros(4)])
    _, (left,), *_ = np.linalg.lstsq(stacked, target, rcond=None)
    assert pair_of(d, columns, weights).left == pytest.approx(left)


def by_hand(left, contributed, error, granted, richer=((False, False), (False, False)), bent=0.0):
    """Information of a motion by hand: T both ways, what laws contribute, and their relative errors: own, granted."""
    pair = pair_of(np.full(4, np.sqrt(left / 4.0)), np.zeros((0, 4)), np.ones(4))
    laws = Laws(np.zeros(2), np.ones(2), np.full(2, error / granted), 0.6, np.array(richer))
    granted = np.full(2, granted**2 * contributed)
    return Information({(0, 1): pair, (1, 0): pair}, granted, np.full(2, bent), laws)


def test_probability_is_that_of_a_normal_law_beyond_what_chance_and_the_laws_ask_for():
    """T = 64. Chance asks for 4 sigma; a truth that leaves 0.1^2 of 9000 and a share of 0.6 for T* = 135."""
    assert by_hand(64.0, 9000.0, 0.0, 0.1).probability == pytest.approx(norm.cdf(8.0 - CHANCE))
    found = by_hand(64.0, 9000.0, 0.1, 1.0)
    assert found.probability == pytest.approx(norm.cdf((8.0 - np.sqrt(135.0)) / np.sqrt(1.0 + UNSURE**2 * 135.0)))
    both = found + found
    assert both.left[0, 1] == pytest.approx(128.0) and both.required(0, 1) == pytest.approx(270.0)


def test_what_a_law_is_granted_rejects_it_where_less_than_a_share_would():
    """Granted 0.15^2 of 9000 less the 90 that the truth leaves: T* = 112.5, not 135."""
    assert by_hand(64.0, 9000.0, 0.1, 0.15).required(0, 1) == pytest.approx(112.5)


def test_what_no_linearisation_describes_counts_as_left_by_a_true_law():
    """What plausible robots miss it by counts as a true law's excess does: (100 + 100) 0.6 / 0.4."""
    assert by_hand(64.0, 9000.0, 0.1, 0.15, bent=100.0).required(0, 1) == pytest.approx(300.0)


def test_a_richer_law_rejects_a_simpler_one_beyond_what_that_is_granted_alone():
    """0.4^2 of 9000 less 90, more than a share of 0.6; the simpler one against the richer one is as probable."""
    found = by_hand(64.0, 9000.0, 0.1, 0.4, ((False, True), (False, False)))
    assert found.required(0, 1) == pytest.approx(1350.0)
    assert found.power(0, 1) == found.power(1, 0) and found.closest == (0, 1)


def test_frames_that_no_linearisation_describes_count_little(contest, problem, monkeypatch):
    """Where drawn robots miss the linearisation by 10 standard deviations of noise, weights are 1 / 201."""
    reference = problem.fit[0].reference
    half = len(reference) // 2 * len(problem.columns)

    def injected_miss(missed):
        monkeypatch.setattr(inside, "nonlinearity", lambda *args: np.tile(missed, (2, 1)))
        found = information(contest, reference)
        assert found is not None
        return found.pairs[0, 1].square

    none = np.zeros(len(reference) * len(problem.columns))
    first, all_of_it = none.copy(), none + 100.0
    first[:half] = 100.0
    whole = injected_miss(none)
    assert injected_miss(all_of_it) == pytest.approx(whole / 201.0)
    assert whole / 201.0 < injected_miss(first) < whole


def test_a_refit_carried_to_its_end_leaves_what_its_robot_leaves(problem):
    """The same law with a coefficient of 300 instead of 150: T by a run of the robot that the refit ends with."""
    twice = Rival(VISCOUS.effects, {"carriage.viscous_friction.coefficient": 300.0})
    contest = contest_of(problem, [VISCOUS, twice])
    reference = problem.fit[0].reference
    linear, terms = information(contest, reference), inside.terms_of(contest, reference)
    found = refitted(contest, reference)
    assert linear is not None and terms is not None and found is not None
    left, z = found.left[0, 1], found.refit(0, 1)
    e = contest.explanations[1]
    robot = apply(e.values, e.parameters, np.clip(e.x + contest.spreads[1] @ z, *e.bounds))
    misfit = terms.likelihood.residual(robot[None])[0] - terms.rows[0]
    assert left <= linear.left[0, 1]
    if left < linear.left[0, 1]:
        assert terms.weights(0, 1) @ misfit**2 + z @ z == pytest.approx(left)


def test_a_snap_of_a_few_frames_counts_no_more_than_a_small_difference_of_all(contest):
    """1000 standard deviations of noise in 3 of 1000 frames tell 0.003 log(1 + 1e6) = 0.04, one in all log 2."""
    runs = np.zeros((2, 1000, contest.records(Reference(contest.problem.fit[0].reference[:2])).shape[2]))
    snap, steady, at = runs.copy(), runs.copy(), contest.problem.signal_indices
    snap[1, 500:503, at] = 1000.0 * contest.problem.noise_std[:, None]
    steady[1][:, at] = contest.problem.noise_std
    assert contest.difference(snap) == pytest.approx(0.003 * np.log(1.0 + 1e6))
    assert contest.difference(steady) == pytest.approx(np.log(2.0))


def test_band_of_the_figure_holds_the_error_that_each_law_shows(contest):
    """Its variance is that of noise and of the errors of both laws: (a rho)^2 times the contribution's square."""
    reference, problem = Reference(contest.problem.fit[0].reference[:100]), contest.problem
    nothing = np.zeros(contest.spreads[1].shape[1])
    told = SimpleNamespace(closest=(0, 1), refit=lambda true, rival: nothing)
    error, rho = np.array([0.5, 2.0]), calibration_of(problem.robot.machine).law_error
    laws = replace(contest.laws, error=error)
    found = difference_of(replace(contest, laws=laws), SimpleNamespace(reference=reference, information=told))
    variance = np.tile(problem.noise_std**2, (100, 1))
    for a, e in zip(error, contest.explanations, strict=True):
        without = e.robot.copy()
        (name,) = {*VISCOUS.parameters, *COULOMB.parameters} & {p.name for p in e.parameters if p.effect}
        without[problem.robot.machine.index[name]] = 0.0
        logs = problem.predict(np.array([e.robot, without]), trial_of(contest, reference.values))
        variance += (a * rho * (logs[1] - logs[0])) ** 2
    assert found.band**2 == pytest.approx(variance, rel=1e-6)


def test_page_counts_each_motion_where_it_ran():
    """Of two cases with the truth `a` both are resolved by a random motion, one by the designed one that ran."""
    right, wrong = ({"verdict": "NAMED", "class": [name], "taken": {"b": 0.9}} for name in "ab")
    before = {"verdict": "AMBIGUOUS", "class": ["a", "b"]}
    row = {"truth": ["a"], "before": before, "promised": {}, "after": {"random": right}}
    told = {"designed": {"probability": 0.5, "left": 20.0}}
    other = row | {"promised": told, "after": {"random": right, "designed": wrong}}
    text = page({"s/one": row, "s/two": other}, "command")
    assert "| designed | 0 of 1 (0% to 79%) | 0 of 1 (0% to 79%) | 1 | 50% |" in text
    assert "| random | 2 of 2 (34% to 100%) | 2 of 2 (34% to 100%) | 0 | - |" in text
    assert "| -, - | not measured | NAMED a | yes |" in text and "| 20, - | NAMED b | NAMED a | yes |" in text
    assert "| a, b | 2 | 2 | 0 of 1 | 2 of 2 |" in text


def test_page_pairs_motions_by_an_exact_test():
    """Six cases that the designed motion alone resolves: p = 2 / 2^6; a log that is the same resolves none."""
    right, left = ({"verdict": v, "class": c, "taken": {"b": 0.9}} for v, c in (("NAMED", "a"), ("AMBIGUOUS", "ab")))
    row = {"truth": ["a"], "before": left, "promised": {}, "after": {"random": left, "designed": right}}
    same = row | {"after": dict.fromkeys(("random", "designed"), left | {"same": True})}
    text = page({**{f"s/{k}": row for k in range(6)}, "s/same": same}, "command")
    assert "Of 7 cases with both motions 0 are resolved by either one, 6 by the designed one alone, 0 by" in text
    assert "p = 0.031" in text and "| the same log | the same log | no |" in text


def test_equal_explanations_leave_nothing(problem):
    found = information(contest_of(problem, [VISCOUS, VISCOUS]), problem.fit[0].reference)
    assert found is not None and max(found.left.values()) == 0.0


def test_the_error_of_a_wrong_law_is_larger_than_that_of_the_true_one(contest):
    """The carriage follows the viscous law of the library: what it leaves is noise, and the least error is granted."""
    (true, wrong), limits = contest.laws.error, calibration_of(contest.problem.robot.machine)
    assert true == pytest.approx(limits.same_meaning / limits.law_error) and wrong > 3.0 * true


def test_a_law_that_is_known_is_granted_less_of_what_it_contributes(problem):
    """A constant force of 3 N beside viscous friction: 0.05 of what it contributes, 0.4 of what friction does."""
    limits, (offset, friction) = calibration_of(problem.robot.machine), ("carriage.offset", *VISCOUS.effects)
    both = Rival((friction, offset), VISCOUS.parameters | {"carriage.offset.force": 3.0})
    likelihood, (e, _) = (found := contest_of(problem, [both, VISCOUS])).likelihood, found.explanations
    granted = contributed(likelihood, e, e.residual)
    whole = contributions(problem.robot.machine, e, likelihood.residual, e.residual)
    assert granted[offset] == pytest.approx(limits.same_meaning * whole[offset]) and whole[offset].any()
    assert granted[friction] == pytest.approx(limits.law_error * whole[friction]) and whole[friction].any()


def test_a_fit_that_is_stuck_goes_on_from_a_simpler_law(problem):
    """Dry friction that falls with speed holds constant friction: it must not leave more than that."""
    rivals = [COULOMB, Rival(("carriage.stribeck_friction",), {"carriage.stribeck_friction.force": 3.0})]
    contest = contest_of(problem, rivals)
    simpler, stuck = contest.explanations
    assert stuck.cost(contest.likelihood) > simpler.cost(contest.likelihood)
    found = from_another_law(contest.likelihood, stuck, [simpler, stuck], np.inf)
    assert found.effects == stuck.effects
    assert found.cost(contest.likelihood) < 1.02 * simpler.cost(contest.likelihood)


def test_another_speed_tells_viscous_from_coulomb_friction_the_same_speed_does_not(contest):
    """At one constant speed v a viscous force c v is a Coulomb force; at other speeds it is not."""
    stage = stage_of(contest.problem.robot, contest.problem.fit)
    s = np.linspace(0.0, 1.0, 8001)[:, None]
    one, two = 0.2 + 0.6 * s, np.where(s < 0.5, 0.2 + 0.2 * s, 0.3 + (s - 0.5))
    both = [information(contest, stage.reference(shares).values) for shares in (one, two)]
    assert both[0] is not None and both[1] is not None
    assert min(both[1].left.values()) > 3.0 * min(both[0].left.values())


def test_random_motifs_stay_within_the_span_and_return_to_rest():
    rng, rest = np.random.default_rng(0), np.array([0.0, 0.3, 1.0])
    for _ in range(50):
        motif = random_motif(3, rng)
        shares = motif.mutated(rng).shares(300, rest)
        assert shares.min() >= 0.0 and shares.max() <= 1.0
        assert shares[0] == pytest.approx(rest) and shares[-1] == pytest.approx(rest)


def test_limited_courses_keep_the_rate_and_both_ends():
    rows = np.concatenate([np.zeros(50), np.ones(100), np.zeros(60)])[:, None]
    out = limited(rows, np.array([0.02]), 5)
    assert np.abs(np.diff(out, axis=0)).max() <= 0.02 + 1e-12
    assert out[0] == 0.0 and out[-1] == pytest.approx(0.0, abs=0.05) and out.max() == pytest.approx(1.0)
    assert np.array_equal(limited(rows, np.array([np.inf]), 5), rows)


def test_what_goes_beyond_a_limit_is_named(contest):
    """The same motion with the range of the position set just below and just above its peak."""
    safety = safety_of(contest.problem, contest.robots, [])
    reference = Reference(contest.problem.fit[0].reference)
    records = contest.records(reference)
    assert safety.violations(contest.names, records) == []
    k = next(k for k, label, _ in search_labels(safety) if label == "position_carriage")
    peak = records[:, :, k].max(axis=1)
    low = replace(safety, high=np.where(np.arange(len(safety.high)) == k, peak.min() - 1e-6, safety.high))
    said = low.violations(contest.names, records)
    assert said and all("position_carriage" in sentence for sentence in said)
    over = [name for name, top in zip(contest.names, peak, strict=True) if top > peak.min() - 1e-6]
    assert len(said) == len(over)
    slow = replace(safety, rate=np.where(np.arange(len(safety.rate)) == k, 1e-9, safety.rate))
    assert any("m/s" in sentence or "mm/s" in sentence for sentence in slow.violations(contest.names, records))


def search_labels(safety):
    from exodrake.experiment.safety import labels

    return labels(safety.machine)


def test_search_is_seeded_safe_and_distinguishes_more_than_one_speed(contest, few):
    one, again, other = (design(contest, 20.0, seed) for seed in (1, 1, 2))
    assert np.array_equal(one.reference.values, again.reference.values)
    assert not np.array_equal(one.reference.values, other.reference.values)
    assert one.safety.violations(contest.names, contest.records(one.reference)) == []
    low, high = contest.problem.robot.reference_limits()
    course = one.reference.values[:, :1]
    assert (course >= low).all() and (course <= high).all()
    stage = stage_of(contest.problem.robot, contest.problem.fit)
    speed = information(contest, stage.reference(0.2 + 0.6 * np.linspace(0.0, 1.0, 8001)[:, None]).values)
    assert speed is not None and one.information.criterion > speed.criterion


def test_search_refuses_what_no_limit_allows(contest, few, monkeypatch):
    closed = safety_of(contest.problem, contest.robots, [])
    shut = replace(closed, high=np.full_like(closed.high, -1e3))
    monkeypatch.setattr(search, "safety_of", lambda *_: shut)
    with pytest.raises(InputError, match="no motion is safe"):
        design(contest, 20.0)


@pytest.mark.parametrize("duration", [5.0, 61.0])
def test_length_out_of_range_is_refused(duration):
    with pytest.raises(InputError, match="wanted 20 to 60 s"):
        frames_of(duration, 0.02)
    assert frames_of(120.0, 1.0) == 120


def test_log_of_an_experiment_is_used_in_full_length(problem):
    log = problem.case.logs[0]
    case = replace(problem.case, logs=(log, replace(log, protocol="experiment", file="experiment.csv")))
    short = make_problem(case, problem.robot).shortened(0.35)
    whole = len(log.log)
    assert [len(trial.reference) for trial in short.fit] == [int(0.35 * whole), whole]


@pytest.fixture(scope="module")
def answered(problem, tmp_path_factory):
    """A case folder with an ambiguous answer."""
    folder = tmp_path_factory.mktemp("case")
    write_case(problem.case, folder)
    case = read_case(folder, required_of(problem.robot.machine), problem.robot.machine.frame)
    made = provenance_of(make_problem(case, problem.robot))
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
    assert out.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    again = tmp_path / "again.csv"
    result = run("experiment", answered / "diagnosis.json", "--robot", "emps", "--out", again, "--duration", 20)
    assert result.exit_code == 0 and again.read_bytes() == out.read_bytes()


def test_command_refuses_a_second_case(answered, tmp_path):
    result = run("experiment", answered, "--case", answered, "--robot", "emps", "--out", tmp_path / "reference.csv")
    assert result.exit_code == 2 and "is a case itself" in result.output


def test_command_says_why_there_is_nothing_to_do(answered, tmp_path):
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
