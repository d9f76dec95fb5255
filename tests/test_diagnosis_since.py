"""Since when: the change-point scan on drawn series, and simulated robots that wear, loosen, drift or stay."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from report_synthetic import diagnosis, simulated_logs
from scipy.stats import binomtest

import exodrake as exo
from exodrake.core.confidence import ALPHA
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.change_point import RAMP, STEP, Change, ChangePoint
from exodrake.diagnosis.isolation import isolate
from exodrake.diagnosis.problem import make_problem, with_recorded_ranges
from exodrake.diagnosis.result import NAMED
from exodrake.diagnosis.since import Series, Since, date_sessions, follow_sessions
from exodrake.diagnosis.verdict import Decision, decide
from exodrake.model.robot import drawn_robot
from exodrake.report.diagnosis_html import render_report, since as since_section
from exodrake.report.wording import since_words as words
from exodrake.simulation import protocols
from exodrake.simulation.protocols import on_machine
from studies.since import KINDS, SESSIONS, sheath_case

SHAPES = {STEP: lambda t, tau: (t > tau) * 1.0, RAMP: lambda t, tau: np.maximum(t - tau, 0.0)}


@pytest.mark.parametrize("scatter", [1.0, 30.0])
def test_steady_series_change_at_the_level_of_the_test_whatever_their_scatter(scatter):
    """Exact where the scatter is large, and conservative at s = 1."""
    rng, times = np.random.default_rng(1), np.array([0.0, 1, 2, 3, 5, 8, 9, 10])
    root = np.tril(rng.normal(0.2, 0.1, (8, 8))) + np.diag(rng.uniform(0.5, 2.0, 8))
    series = 7.0 + scatter * root @ rng.standard_normal((8, 2000))
    alarms = int((ChangePoint(times, root @ root.T).p_values(series) < ALPHA).sum())
    assert binomtest(alarms, 2000, ALPHA, alternative="greater").pvalue > 1e-3
    if scatter > 1.0:
        assert binomtest(alarms, 2000, ALPHA / 2, alternative="greater").pvalue < 0.05


@pytest.mark.parametrize("shape, size", [(STEP, 8.0), (RAMP, 2.0)])
def test_dates_and_sizes_are_covered_as_stated(shape, size):
    """90 % sets of 60 drawn changes each cover the true date and last value in at least 80 % of cases."""
    rng, times, dates, sizes = np.random.default_rng(2), np.arange(12.0), 0, 0
    scan = ChangePoint(times, np.eye(12))
    for _ in range(60):
        tau = rng.uniform(1.5, 8.5)
        found = scan(1.0 + size * SHAPES[shape](times, tau) + rng.standard_normal(12), rng)
        dates += found.began[1] <= tau <= found.began[2]
        sizes += found.after[1] <= 1.0 + size * SHAPES[shape](times[-1:], tau)[0] <= found.after[2]
    for hits in (dates, sizes):
        assert binomtest(int(hits), 60, 0.9, alternative="less").pvalue > 0.01


def test_a_clear_step_is_dated_to_its_gap_and_a_clear_ramp_to_its_slope():
    times, rng = np.array([0.0, 1, 2, 4, 5, 6, 7]), np.random.default_rng(0)
    scan = ChangePoint(times, 0.01**2 * np.eye(7))
    step = scan(1.0 * (times > 3) + 0.01 * rng.standard_normal(7), rng)
    assert step.shape == STEP and step.began == (3.0, 2.0, 4.0) and step.p < ALPHA
    assert step.after[0] == pytest.approx(1.0, abs=0.02) and np.isnan(step.rate[0])
    ramp = scan(2.0 + 0.5 * np.maximum(times - 2.0, 0) + 0.01 * rng.standard_normal(7), rng)
    assert ramp.shape == RAMP and ramp.began[1] <= 2.0 <= ramp.began[2]
    assert ramp.rate[0] == pytest.approx(0.5, abs=0.02) and ramp.before[0] == pytest.approx(2.0, abs=0.02)


def answered(case, nominal) -> tuple[Since | None, Decision]:
    """Changes and decision of a case."""
    found = isolate(make_problem(case, nominal))
    return follow_sessions(found, decide(found))


def sessions(effect, values, seed, machine="so101"):
    """Short logs of one robot, a session a day; values: of the effect's first parameter by session, None without it."""
    nominal = exo.load_robot(machine)
    base, logs = drawn_robot(nominal, np.random.default_rng(seed)), []
    name = nominal.machine.effect(effect).parameters[0].name
    for k, value in enumerate(values):
        robot = base if value is None else base.splice(effect, {name: value})
        reference = on_machine(protocols.random_motion, nominal, duration=8.0, seed=k, fastest=1.0)
        log, day = exo.simulate(robot, reference, seed=1000 * seed + k), datetime(2026, 3, 1 + k, tzinfo=UTC)
        logs.append(CaseLog(log, "random", "fit", None, f"{k}.csv", day))
    return Case("sessions", {}, tuple(logs), nominal.machine.frame), nominal


def test_a_dead_band_that_grows_is_dated_in_every_servo():
    """Wear: 0.05 rad until the fourth day, then 0.01 rad more each day."""
    case, nominal = sessions("servo.dead_band", [0.05 + 0.01 * max(k - 3, 0) for k in range(8)], seed=3)
    since, _ = answered(case, nominal)
    assert since.clearest.name == "servo.dead_band.half_width" and since.unit == "d"
    assert since.sessions[0] == "2026-03-01" and len(since.series) == 6
    change = since.clearest.change
    assert change.began[1] <= 3.0 <= change.began[2] and change.began[2] - change.began[1] <= 2.0
    assert change.rate[0] == pytest.approx(0.01, rel=0.1) and RAMP in change.shapes
    assert since.to_json()["changed"] is True


def test_an_effect_that_changed_is_named_where_no_constant_one_explains():
    """A sheath that is donned anew twice: its zero lies 0.02, then 0.05, then 0.03 rad off."""
    case, nominal = sessions("sheath.offset", [0.02] * 4 + [0.05] * 2 + [0.03] * 2, seed=1, machine="tendon_sheath")
    since, decided = answered(case, nominal)
    assert decided.verdict == NAMED and [p.effect for p in decided.causes] == ["sheath.offset"]
    assert since.effect == "sheath.offset" and since.chi2 < 1.5 and since.lead > 0.9 and since.p < 1e-6
    assert "for each session" in decided.reasons[0] and decided.causes[0].share.value > 0.9
    truth = [0.02] * 4 + [0.05] * 2 + [0.03] * 2
    np.testing.assert_allclose(since.series[0].values, truth, atol=5e-4)


@pytest.mark.parametrize("number", [3, 6007])
def test_sessions_tell_the_cause_where_constant_parameters_mistake_it(number):
    """Play that grows may be hysteresis of the reading to constant parameters, a gain that drifts is nothing."""
    kind = KINDS[number // 1000]
    case, nominal, begin = sheath_case(kind, number)
    since, decided = answered(case, nominal)
    assert decided.verdict == NAMED and [p.effect for p in decided.causes] == [kind.effect]
    change = since.clearest.change
    assert change.began[1] <= begin <= change.began[2]
    width = change.after[2] - change.after[1]
    assert change.after[0] == pytest.approx(kind.value(SESSIONS - 1.0, begin), abs=width)  # twice the 90 % interval


def test_a_steady_robot_has_no_date():
    case, nominal = sessions("servo.latency", [2.0] * 6, seed=2)
    since, _ = answered(case, nominal)
    assert since.clearest is None and since.to_json()["changed"] is False and since.p > 0.5
    values = np.array([[s.low, s.high] for s in since.series])  # (joints, ends, sessions) of two frames of latency
    held = int(((values[:, 0] <= 2.0) & (values[:, 1] >= 2.0)).sum())
    assert binomtest(held, values[:, 0].size, 0.9, alternative="less").pvalue > 0.01


def test_few_sessions_are_not_dated_and_undated_cases_have_no_sessions():
    case, nominal = sessions("servo.latency", [2.0] * 3, seed=2)
    assert "3 sessions" in answered(case, nominal)[0].note
    names = [item.file for item in case.logs]
    assert [s.time for s in date_sessions(case, names)] == [0.0, 1.0, 2.0]
    bare = Case("bare", {}, tuple(CaseLog(i.log, "random", "fit", None, i.file) for i in case.logs), case.period)
    assert date_sessions(bare, names) == ()


def test_one_long_log_is_dated_by_windows():
    """A sheath whose zero moves by 0.03 rad after 48 of 80 s of a log."""
    nominal = exo.load_robot("tendon_sheath")
    motion = on_machine(protocols.random_motion, nominal, duration=80.0, seed=1, fastest=1.0)
    before, after = (exo.simulate(r, motion, seed=1) for r in (nominal, nominal.splice("sheath.offset")))
    moved = np.where(before.time >= 48.0, after["angle_bending"], before["angle_bending"])
    log = before.with_signals({"angle_bending": moved})
    case = Case("long", {}, (CaseLog(log, "random", "fit", None, "long.csv"),), nominal.machine.frame)
    since, _ = answered(case, with_recorded_ranges(nominal, case))
    assert since.unit == "s" and len(since.sessions) == 8
    change = since.clearest.change
    assert change.began[1] <= 48.0 <= change.began[2] and change.began[2] - change.began[1] <= 40.0
    (text,) = words(replace(diagnosis(NAMED), since=since))[:1]
    assert " s and " in text or "about" in text


def changed(shape, dates=("2026-03-01", "2026-03-02", "2026-03-03", "2026-03-05", "2026-03-06")):
    """A synthetic answer whose friction changed after the third session."""
    rate = (0.02, 0.015, 0.025) if shape == RAMP else (np.nan,) * 3
    change = Change(0.001, shape, (shape,), (2.5, 2.0, 4.0), (0.1, 0.09, 0.11), (0.15, 0.14, 0.16), rate, 1.0, 50.0)
    values = (0.1, 0.1, 0.1, 0.13, 0.15)
    series = Series("tendon.capstan_friction.mu_phi", "AF", "-", values, values, values, 0.002, change)
    return replace(diagnosis(NAMED), since=Since(dates, (0.0, 1.0, 2.0, 4.0, 5.0), "d", (series,)))


def test_the_change_in_words_and_on_the_page():
    found = changed(RAMP)
    (text,) = words(found)
    assert "began between 2026-03-03 and 2026-03-05 (90 %)" in text and "20 % of the value before" in text
    assert found.to_json()["since"]["began"] == {"value": "2026-03-03", "low": "2026-03-03", "high": "2026-03-05"}
    values = since_section(found)
    (line,) = values["timelines"]
    assert line["times"][3] - line["times"][2] == 2 * 86400 and line["began"][1] == line["times"][2]
    html = render_report(found, simulated_logs(found.robots["nominal"], frames=200))
    assert (
        "Since when" in html
        and 'id="timelines"' in html
        and "timelines"
        not in render_report(diagnosis(NAMED), simulated_logs(found.robots["nominal"], frames=200))
        .split("</style>")[1]
        .split("<script>")[0]
    )
    assert "a day" not in words(changed(STEP))[0]
