"""Calibration: error rates counted by hand and against scipy, its file, and robots drawn for it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.stats import binomtest

from exodrake.cli.main import cli
from exodrake.core.errors import InputError
from exodrake.core.schema import parse_yaml, read_yaml
from exodrake.data.case import Case, CaseLog, write_case
from exodrake.diagnosis import calibrate as simulated_robots, calibration, pipeline
from exodrake.diagnosis.calibrate import Record, calibrate, count_rates, draw_value, follow_case, record
from exodrake.diagnosis.calibration import (
    ALARM,
    CLASS,
    COVERED,
    NAMED,
    RATES,
    UNKNOWN,
    UNSEEN,
    Calibration,
    calibration_notes,
    calibration_text,
    read_calibration,
)
from exodrake.diagnosis.result import REFINEMENT, EffectRival, Interval, NamedEffect
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import load_robot, machine_folders
from exodrake.simulation.simulate import simulate

SHEATH = "tendon_sheath"


def sheath_case(gap: bool = False) -> Case:
    """A sheath that follows three sums of sines for 10 s each; `gap`: the first log lacks some samples."""
    robot, time = load_robot(SHEATH), 0.025 * np.arange(400)
    logs = []
    for k, role in enumerate(("fit", "fit", "holdout")):
        angle = 0.5 * np.sin(2.0 * np.pi * (0.2 + 0.1 * k) * time) + 0.3 * np.sin(5.0 * time + k)
        reference = np.column_stack([angle, np.full(400, angle[0]), np.full(400, 0.4 * k)])
        log = simulate(robot, Reference(reference, f"{k}"), seed=k)
        if gap and k == 0:
            log = log.with_signals({"angle_bending": np.where(np.arange(400) // 20 == 3, np.nan, log["angle_bending"])})
        logs.append(CaseLog(log, f"motion {k}", role, None, f"{k}.csv"))
    return Case("sheath", {}, tuple(logs), robot.machine.frame)


@pytest.mark.parametrize("k, n", [(0, 3), (5, 5), (17, 20), (1, 33)])
def test_rates_have_clopper_pearson_intervals(k, n):
    wanted = binomtest(k, n).proportion_ci(0.95, method="exact")
    found = parse_yaml(calibration_text(Calibration(rates={ALARM: (k, n)})).encode(), "")["rates"][ALARM]
    assert (found["k"], found["n"]) == (k, n)
    assert (found["low"], found["high"]) == pytest.approx((wanted.low, wanted.high), abs=6e-5)


def test_rates_count_each_kind_of_robot_apart():
    records = [
        *[Record("", verdict) for verdict in ("NO_GAP", "RETUNE")],
        Record("", "PARTLY", causes=1),
        Record("a", "NAMED", named=True, in_class=True, causes=1, covered=(True, False)),
        Record("a", "AMBIGUOUS", in_class=True, causes=1),
        Record("a", "UNKNOWN"),
        Record("a", "RETUNE"),
    ]
    wanted = {ALARM: (1, 3), NAMED: (1, 4), CLASS: (2, 4), UNKNOWN: (1, 4), UNSEEN: (1, 4), COVERED: (1, 2)}
    assert count_rates(records) == wanted and list(wanted) == list(RATES)


def answered(*effects, verdict="NAMED"):
    return SimpleNamespace(verdict=verdict, effects=effects, run_time=1.0)


def test_an_answer_is_right_by_its_causes_their_rivals_and_intervals():
    def named(identity, role="cause", rivals=(), channels=None):
        rivals = tuple(EffectRival(i, Interval(0.9, 0.8, 1.0)) for i in rivals)
        return NamedEffect(identity, (), (), {}, channels or {}, "", role, rivals=rivals)

    true = load_robot("exo_index").splice("sensor.gain", {"gain": {"AF": 0.05}}, ["AF"])
    near = {"gain": {"AF": Interval(0.051, 0.049, 0.052), "MF": Interval(0.01, 0.005, 0.02)}}
    found = record(answered(named("sensor.gain", channels=near), named("x", REFINEMENT)), true, "sensor.gain")
    assert found.named and found.in_class and found.causes == 1 and found.covered == (True, False)
    found = record(answered(named("motor.friction", rivals=["sensor.gain"])), true, "sensor.gain")
    assert not found.named and found.in_class and not found.covered
    assert not record(answered(named("sensor.gain"), named("motor.friction")), true, "sensor.gain").named
    assert record(answered(verdict="UNKNOWN"), true, "sensor.gain") == Record("sensor.gain", "UNKNOWN")


def test_another_law_is_in_class_by_its_family_and_block():
    robot = load_robot("exo_index")

    def in_class(stated, true):
        return record(answered(NamedEffect(stated, (), (), {}, {})), robot, true).in_class

    assert in_class("motor.spool_growth", "motor.spool_layers")
    assert in_class("tendon.coulomb_friction", "tendon.presliding")
    assert not any(in_class(e.id, "sensor.gain") for e in robot.machine.effects if e.id != "sensor.gain")


def test_file_is_read_back_and_the_note_states_the_rates(tmp_path, monkeypatch):
    machine = load_robot(SHEATH).machine
    monkeypatch.setattr(calibration, "machine_folders", lambda: {SHEATH: tmp_path})
    assert read_calibration(machine) == Calibration()
    assert calibration_notes(machine) == ()
    counts = dict.fromkeys(RATES, (0, 20)) | {ALARM: (1, 20), NAMED: (17, 20)}
    given = Calibration("exodrake calibrate, 2026-01-01", "abc", counts)
    (tmp_path / "calibration.yaml").write_text(calibration_text(given))
    assert read_calibration(machine) == given
    (note,) = calibration_notes(machine)
    assert "of 20 healthy robots of this kind 1 was given a cause; of 20 with one effect 17 were named rightly" in note
    assert "another version" in note
    (tmp_path / "calibration.yaml").write_text(calibration_text(given).replace("k: 17", "k: -1"))
    with pytest.raises(InputError, match=r"calibration\.yaml"):
        read_calibration(machine)


def test_values_are_drawn_in_the_plausible_range():
    contact = load_robot("exo_index").machine.effect("finger.contact")
    distance, stiffness, _ = contact.parameters
    rng = np.random.default_rng(2)
    drawn = np.array([draw_value(stiffness, rng) for _ in range(4000)])
    assert stiffness.low <= drawn.min() and drawn.max() <= stiffness.high
    assert np.log(drawn).mean() == pytest.approx(np.log(1000.0), abs=0.07)  # log-uniform on 100 .. 10,000
    assert distance.transform == "reciprocal" and distance.low <= draw_value(distance, rng) <= distance.high


def test_robots_follow_the_motion_of_the_case():
    case, robot = sheath_case(gap=True), load_robot(SHEATH)
    made = follow_case(case, robot.splice("sheath.gain", {"gain": 0.1}), np.random.default_rng(4))
    assert [(x.role, x.file) for x in made.logs] == [(x.role, x.file) for x in case.logs]
    for new, old in zip(made.logs, case.logs, strict=True):
        assert new.log.columns == old.log.columns
        assert (np.isnan(new.log["angle_bending"]) == np.isnan(old.log["angle_bending"])).all()
        np.testing.assert_array_equal(new.log["angle_ref_bending"], old.log["angle_ref_bending"])
        ratio = np.nanstd(new.log["angle_bending"]) / np.nanstd(old.log["angle_bending"])
        assert ratio == pytest.approx(1.1, abs=0.01)


def test_records_depend_on_the_seed_and_not_on_jobs():
    case = sheath_case()
    alone, failed = calibrate(SHEATH, 2, 5, case, jobs=1)
    assert not failed and alone == calibrate(SHEATH, 2, 5, case, jobs=2)[0]
    assert alone[:1] == calibrate(SHEATH, 1, 5, case)[0] and alone != calibrate(SHEATH, 2, 6, case)[0]
    assert alone[0].effect == "" and all(r.effect for r in alone[1:])
    assert len(calibrate(SHEATH, 5, 5, case, seconds=0.0)[0]) == 1  # time that ends leaves fewer robots


def test_a_robot_whose_loop_diverges_is_drawn_again(monkeypatch):
    """No such robot is recorded: its logs grow without end."""
    case, made = sheath_case(), []

    def follow(motion, robot, rng):
        case = follow_case(motion, robot, rng)
        made.append((case, robot))
        if len(made) > 2:
            return case
        first, *others = case.logs
        grown = np.where(np.arange(400) < 200, first.log["angle_bending"], (np.inf, 1e9)[len(made) - 1])
        return replace(case, logs=(replace(first, log=first.log.with_signals({"angle_bending": grown})), *others))

    monkeypatch.setattr(simulated_robots, "follow_case", follow)
    monkeypatch.setattr(simulated_robots, "record", lambda answer, robot, effect: (answer, robot, effect))
    monkeypatch.setattr(pipeline, "diagnose", lambda case, nominal: case)
    answered, robot, effect = simulated_robots.simulated_robot(SHEATH, case, 5, 1)
    assert len(made) == 3 and (answered, robot) == made[-1] and effect


def test_error_rates_of_a_sheath():
    records, failed = calibrate(SHEATH, 12, 1, sheath_case())
    found = count_rates(records)
    assert not failed and found[ALARM][1] == 4 and found[ALARM][0] <= 1
    assert found[CLASS][0] >= 0.6 * found[CLASS][1] > 0


def test_command_prints_and_writes_the_rates(tmp_path):
    write_case(sheath_case(), tmp_path / "case")
    file = tmp_path / "calibration.yaml"
    words = ["calibrate", "--robot", SHEATH, "--case", str(tmp_path / "case"), "--cases", "2", "--out", str(tmp_path)]
    result = CliRunner().invoke(cli, words)
    assert result.exit_code == 0, result.output
    assert ALARM in result.stdout and "of 1" in result.stdout
    written = read_yaml(file)
    assert written["source"].startswith("exodrake calibrate --robot tendon_sheath --case case --cases 2 --seed 0")
    assert set(written["rates"]) == set(RATES) and written["rates"][ALARM]["n"] == 1
    assert str(tmp_path) not in file.read_text()
    result = CliRunner().invoke(cli, ["calibrate", "--robot", "emps", "--cases", "1", "--out", str(tmp_path)])
    assert result.exit_code == 2 and "--case CASE" in result.stderr


@pytest.mark.parametrize("name", machine_folders())
def test_shipped_calibration_is_well_formed(name):
    machine = load_robot(name).machine
    found = read_calibration(machine)
    assert bool(calibration_notes(machine)) == (found.rates is not None or not machine.tolerances)
    for k, n in (found.rates or {}).values():
        assert 0 <= k <= n
