"""Calibration: conformal quantiles and binomial intervals by hand, its file, and robots drawn for it."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from exodrake.cli.main import cli
from exodrake.compiled.inputs import Reference
from exodrake.core.errors import InputError
from exodrake.core.yaml_file import read_yaml
from exodrake.data.case import Case, CaseLog, write_case
from exodrake.diagnosis import calibration
from exodrake.diagnosis.calibrate import (
    HEALTHY,
    OTHER_LAW,
    TRIED,
    Record,
    calibrate,
    numbers_of,
    rate,
    rates_of,
    truths,
    upper,
)
from exodrake.diagnosis.calibration import (
    NUMBERS,
    UNCALIBRATED,
    Calibration,
    calibration_notes,
    calibration_of,
    calibration_text,
)
from exodrake.diagnosis.healthy import drawn_value, followed, with_effect
from exodrake.diagnosis.level_table import MEANINGS
from exodrake.machines.library import machine_names
from exodrake.machines.robot_file import load_robot
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


def test_upper_quantile_is_the_least_value_of_the_conformal_p():
    values = np.random.default_rng(0).permutation(np.arange(1.0, 100.0))
    assert upper(values, 0.98, 0.5) == 98.0  # p(98) = (1 + 1) / (1 + 99) = 0.02, p(97) = 0.03
    assert upper(values, 0.95, 0.5) == 95.0
    assert upper(values[:20], 0.95, 0.5) == max(values[:20])  # (1 + 0) / (1 + 20) < 0.05


def test_upper_quantile_of_few_values_is_never_below_the_default():
    assert upper(np.linspace(0.0, 0.1, 48), 0.98, 0.7) == 0.7  # 1 / 49 > 0.02: no value among 48 says 98 %
    assert upper([*np.zeros(47), 0.9], 0.98, 0.7) == 0.9
    assert upper(np.full(19, 9.0), 0.95, 0.7) == 0.7


def test_a_further_value_exceeds_the_quantile_as_often_as_stated():
    draws = np.random.default_rng(1).lognormal(size=(4000, 60))
    exceeded = np.mean([row[-1] > upper(row[:-1], 0.95, 0.0) for row in draws])
    assert exceeded == pytest.approx(0.05, abs=0.011)  # 3 standard deviations of 4000 trials


def test_numbers_come_from_what_robots_show():
    shown = [Record(TRIED, "a", "NAMED", values={"law_error": k / 100, "moved": 0.5}) for k in range(1, 99)]
    other = [Record(OTHER_LAW, "b", "NAMED", values={"law_error": 2.0, "taken": 0.9, "moved": 0.5})]
    found, rests_on = numbers_of(shown + other, "by hand")
    assert found == Calibration(0.95, UNCALIBRATED.same_meaning, UNCALIBRATED.taken, 0.5, "by hand")
    assert rests_on == {"law_error": 99, "same_meaning": 0, "taken": 1, "moved": 99}


def test_robots_of_the_models_own_laws_say_nothing_of_the_error_of_laws():
    shown = [Record(TRIED, "a", "NAMED", values={"law_error": 0.0}) for _ in range(200)]
    found, rests_on = numbers_of(shown, "")
    assert found.law_error == UNCALIBRATED.law_error and rests_on["law_error"] == 0


def test_each_number_of_a_calibration_has_a_meaning():
    assert tuple(MEANINGS) == NUMBERS


def test_exact_numbers_keep_the_difference_between_simulators():
    found, _ = numbers_of([Record(HEALTHY, "", "RETUNE", values={"same_meaning": 0.0})] * 200, "")
    assert found.same_meaning == 0.02


def test_rates_have_clopper_pearson_intervals():
    assert rate([False] * 3) == {"k": 0, "n": 3, "low": 0.0, "high": round(1.0 - 0.025 ** (1 / 3), 4)}
    assert rate([True] * 5) == {"k": 5, "n": 5, "low": round(0.025 ** (1 / 5), 4), "high": 1.0}
    assert rate([]) == {"k": 0, "n": 0, "low": 0.0, "high": 1.0}


def test_rates_count_each_kind_of_robot_apart():
    records = [
        *[Record(HEALTHY, "", verdict) for verdict in ("NO_GAP", "RETUNE", "UNKNOWN")],
        Record(TRIED, "a", "NAMED", named=True, first=True, kept=True),
        Record(TRIED, "a", "AMBIGUOUS", kept=True),
        Record(TRIED, "a", "UNKNOWN"),
        Record(TRIED, "a", "RETUNE"),
        Record(OTHER_LAW, "b", "UNKNOWN", first=True),
    ]
    found = {name: (r["k"], r["n"]) for name, r in rates_of(records).items()}
    assert found["false alarm on healthy"] == (1, 3) and found["effect not seen"] == (1, 5)
    assert found["truth named alone"] == (1, 3) and found["truth kept"] == (2, 3)
    assert found["wrongly UNKNOWN"] == (1, 3) and found["other law: UNKNOWN"] == (1, 1)
    assert found["other law: its family first"] == (1, 1)


def test_file_is_read_back_and_silences_the_note(tmp_path, monkeypatch):
    machine = load_robot(SHEATH).machine
    monkeypatch.setattr(calibration, "machine_folders", lambda: {SHEATH: tmp_path})
    assert replace(calibration_of(machine), moved=UNCALIBRATED.moved) == UNCALIBRATED
    assert "exodrake calibrate --robot tendon_sheath" in calibration_notes(machine)[0]
    given = Calibration(0.31234, 0.02, 0.6, 1.5, "exodrake calibrate, 2026-01-01")
    text = calibration_text(given, {"taken": 49}, {"truth kept": rate([True])})
    (tmp_path / "calibration.yaml").write_text(text)
    assert calibration_of(machine) == Calibration(0.3123, 0.02, 0.6, 1.5, given.source)
    assert calibration_notes(machine) == ()
    (tmp_path / "calibration.yaml").write_text(text.replace("taken: 0.6", "taken: -1"))
    with pytest.raises(InputError, match="taken"):
        calibration_of(machine)


@pytest.mark.parametrize("count", [1, 5, 50])
def test_mean_square_of_so_many_tolerances_exceeds_its_limit_as_often_as_it_says(count):
    squares = np.random.default_rng(count).standard_normal((100_000, count)) ** 2
    assert np.mean(squares.mean(axis=1) > calibration.spread(count)) == pytest.approx(1.0 - calibration.FEW, abs=0.002)


def test_values_are_drawn_in_the_plausible_range():
    contact = load_robot("exo_index").machine.effect("finger.contact")
    distance, stiffness, _ = contact.parameters
    rng = np.random.default_rng(2)
    drawn = np.array([drawn_value(stiffness, rng) for _ in range(4000)])
    assert stiffness.low <= drawn.min() and drawn.max() <= stiffness.high
    assert np.log(drawn).mean() == pytest.approx(np.log(1000.0), abs=0.07)  # log-uniform on 100 .. 10,000
    assert distance.transform == "reciprocal" and distance.low <= drawn_value(distance, rng) <= distance.high


def test_every_set_of_channels_is_drawn():
    robot, rng = load_robot("exo_index"), np.random.default_rng(3)
    sets = set()
    for _ in range(200):
        present = with_effect(robot, robot.machine.effect("sensor.gain"), rng).effects()
        assert list(present) == ["sensor.gain"]
        sets.add(tuple(channel for channel, value in present["sensor.gain"]["gain"].items() if value != 0.0))
    assert len(sets) == 7 and () not in sets
    assert list(with_effect(robot, robot.machine.effect("timing.jitter"), rng).effects()) == ["timing.jitter"]


def test_another_law_is_right_by_its_family_and_block():
    robot = load_robot("exo_index")
    tried = frozenset(e.id for e in robot.machine.effects if not e.not_tried)
    problem = SimpleNamespace(robot=robot, tried=tried)
    assert truths(problem, robot.machine.effect("motor.spool_layers")) == {"motor.spool_growth"}
    assert "tendon.coulomb_friction" in truths(problem, robot.machine.effect("tendon.presliding"))
    assert truths(problem, robot.machine.effect("sensor.gain")) == {"sensor.gain"}
    assert truths(problem, robot.machine.effect("motor.friction")) == set()


def test_robots_follow_the_motion_of_the_case():
    case, robot = sheath_case(gap=True), load_robot(SHEATH)
    made = followed(case, robot.splice("sheath.gain", {"gain": 0.1}), np.random.default_rng(4))
    assert [(x.role, x.file) for x in made.logs] == [(x.role, x.file) for x in case.logs]
    for new, old in zip(made.logs, case.logs, strict=True):
        assert new.log.columns == old.log.columns
        assert (np.isnan(new.log["angle_bending"]) == np.isnan(old.log["angle_bending"])).all()
        np.testing.assert_array_equal(new.log["angle_ref_bending"], old.log["angle_ref_bending"])
        ratio = np.nanstd(new.log["angle_bending"]) / np.nanstd(old.log["angle_bending"])
        assert ratio == pytest.approx(1.1, abs=0.01)


def test_records_depend_on_the_seed_and_not_on_jobs():
    case = sheath_case()
    alone, failed = calibrate(SHEATH, 3, 5, case, jobs=1)
    assert not failed and alone == calibrate(SHEATH, 3, 5, case, jobs=2)[0]
    assert alone[:2] == calibrate(SHEATH, 2, 5, case)[0] and alone != calibrate(SHEATH, 3, 6, case)[0]
    assert alone[0].kind == HEALTHY and {r.kind for r in alone[1:]} == {TRIED}


def test_error_rates_of_a_sheath():
    records, failed = calibrate(SHEATH, 30, 1, sheath_case())
    found = rates_of(records)
    assert not failed and found["false alarm on healthy"]["n"] == 10 and found["false alarm on healthy"]["k"] <= 2
    assert found["truth first"]["k"] >= 0.7 * found["truth first"]["n"] > 0


def test_command_prints_and_writes_the_calibration(tmp_path):
    write_case(sheath_case(), tmp_path / "case")
    file = tmp_path / "calibration.yaml"
    words = ["calibrate", "--robot", SHEATH, "--case", str(tmp_path / "case"), "--cases", "3", "--write", str(file)]
    result = CliRunner().invoke(cli, [*words, "--keep-numbers"])
    assert result.exit_code == 0, result.output
    assert "false alarm on healthy" in result.stdout and "of 1" in result.stdout
    written, in_use = read_yaml(file), calibration_of(load_robot(SHEATH).machine)
    assert written["source"].startswith("exodrake calibrate --robot tendon_sheath --case case --cases 3 --seed 0")
    for name in NUMBERS:  # what the robots gave is said beside what stays
        assert re.search(rf"found .*{name} \d", written["source"]), name
    assert "the numbers in use were kept" in written["source"]
    assert {name: written[name] for name in NUMBERS} == pytest.approx(
        {n: getattr(in_use, n) for n in NUMBERS}, rel=1e-3
    )
    assert written["rests_on"] == {} and written["rates"]["false alarm on healthy"]["n"] == 1
    assert str(tmp_path) not in file.read_text()


@pytest.mark.parametrize("name", machine_names())
def test_shipped_calibration_states_its_command_and_rates(name):
    machine, file = load_robot(name).machine, calibration.machine_folders()[name] / "calibration.yaml"
    found, content = calibration_of(machine), read_yaml(file)
    words = found.source.split(", ")[0].split()
    assert "the numbers in use, of development robots of the Exo-Index, were kept" in found.source
    assert words[:4] == ["exodrake", "calibrate", "--robot", name] and not calibration_notes(machine)
    assert found == Calibration(**{key: content[key] for key in (*NUMBERS, "source")})
    for counted in content["rates"].values():
        assert counted == rate([True] * counted["k"] + [False] * (counted["n"] - counted["k"]))
    count = {key: counted["n"] for key, counted in content["rates"].items()}
    assert count["false alarm on healthy"] + count["effect not seen"] == int(words[words.index("--cases") + 1])
    kinds = ("truth named alone", "other law: its family named alone", "outside: UNKNOWN")
    seen = count["effect not seen"] - content["rates"]["effect not seen"]["k"]
    assert sum(count[kind] for kind in kinds) == seen


def test_machine_without_experiments_asks_for_a_case():
    result = CliRunner().invoke(cli, ["calibrate", "--robot", "emps", "--cases", "1"])
    assert result.exit_code == 2 and "--case CASE" in result.stderr
