"""A case: read back as written, keys checked, and simulated logs never taken for the robot unasked."""

import json
from datetime import datetime

import numpy as np
import pytest
import yaml
from command_line import run

import exodrake as exo
from exodrake.core.errors import InputError
from exodrake.data.case import Case, CaseLog, read_case, write_case
from exodrake.data.formats import read_log, write_log
from exodrake.data.log import CHANGED, MODEL, Log
from exodrake.machines.robot_file import robot_text


def one_log(seed: int, rows: int = 20) -> Log:
    draw = np.random.default_rng(seed)
    return Log(
        0.02 * np.arange(rows), {f"{kind}_AF": draw.normal(size=rows) for kind in ("tension_ref", "tension", "stroke")}
    )


@pytest.fixture
def folder(tmp_path):
    """Three logs and no case.yaml."""
    for seed, name in enumerate(("a.csv", "b.csv.gz", "c.npz")):
        write_log(one_log(seed), tmp_path / name)
    (tmp_path / "labels.json").write_text(json.dumps({"secret": 1}))
    (tmp_path / "notes.txt").write_text("not a log")
    return tmp_path


def refusal(folder, page) -> str:
    (folder / "case.yaml").write_text(page if isinstance(page, str) else yaml.safe_dump(page))
    with pytest.raises(InputError) as caught:
        read_case(folder)
    return str(caught.value)


def test_round_trip(folder):
    logs = (
        CaseLog(one_log(1), "sweeps", "fit", None, "s1.csv"),
        CaseLog(one_log(2), "sweeps", "fit", "s1.csv", "s2.csv.gz"),
        CaseLog(one_log(3), "grasps", "holdout", None, "deep/g.npz"),
    )
    robot = {"tendon": {"stiffness": np.float64(2500.0), "a": [1.0, 2.0]}, "small": 1e-5}
    write_case(Case("wearer 3", robot, logs), folder / "case")
    back = read_case(folder / "case")
    assert back.name == "wearer 3" and back.robot == {"tendon": {"stiffness": 2500.0, "a": [1.0, 2.0]}, "small": 1e-5}
    assert [(x.file, x.protocol, x.role, x.repeats) for x in back.logs] == [
        (x.file, x.protocol, x.role, x.repeats) for x in logs
    ]
    assert all(x.log.equals(y.log) for x, y in zip(back.logs, logs, strict=True))
    assert [[x.file for x in group] for group in back.repeat_groups] == [["s1.csv", "s2.csv.gz"]]
    assert [x.file for x in back.holdout_logs] == ["deep/g.npz"] and back.notes == ()
    assert not list(folder.glob(".*"))


def test_a_case_that_cannot_be_written_leaves_nothing(folder):
    bad = CaseLog(Log(np.arange(3.0), {"tension_AF": np.full(3, np.inf)}), "x", "fit", None, "x.csv")
    with pytest.raises(InputError):
        write_case(Case("bad", {}, (CaseLog(one_log(1), "a", "fit", None, "a.csv"), bad)), folder / "bad")
    outside = CaseLog(one_log(1), "x", "fit", None, "../x.csv")
    with pytest.raises(InputError, match="outside"):
        write_case(Case("bad", {}, (outside,)), folder / "bad")
    assert sorted(p.name for p in folder.iterdir()) == ["a.csv", "b.csv.gz", "c.npz", "labels.json", "notes.txt"]


def test_without_case_file_the_last_of_several_is_held_out(folder):
    case = read_case(folder)
    assert [x.role for x in case.logs] == ["fit", "fit", "holdout"] and case.name == folder.name
    assert [x.protocol for x in case.logs] == ["a", "b", "c"]
    assert case.notes[0].endswith("no case.yaml; 3 logs, held out: c.npz, the others to fit")
    case = read_case(folder / "b.csv.gz")  # one file is a case
    assert case.name == "b" and len(case.fit_logs) == 1 and not case.holdout_logs
    (folder / "case.yaml").write_text("robot: {kp: 6e-3, name: soft}\nlogs: [{file: a.csv}]\n")
    assert read_case(folder).robot == {"kp": 0.006, "name": "soft"}
    (folder / "empty").mkdir()
    for wrong, said in (("none", "no such file or folder"), ("empty", "no logs")):
        with pytest.raises(InputError, match=said):
            read_case(folder / wrong)


def test_clock_faults_are_noted(folder):
    log = one_log(4)
    write_log(log.rows(np.delete(np.arange(20), [5, 6])), folder / "gap.csv")
    (folder / "case.yaml").write_text("logs: [{file: gap.csv}, {file: a.csv, role: holdout}]")
    case = read_case(folder)
    assert len(case.logs[0].log) == 20 and "2 missing frames" in case.notes[0]
    assert "frame is 0.05 s" in refusal(folder, {"period": 0.05, "logs": [{"file": "a.csv"}]})


@pytest.mark.parametrize(
    ("page", "parts"),
    [
        ("", ["case.yaml", "found nothing"]),
        ("a: [", ["case.yaml", "line 1", "not YAML"]),
        ("\x00", ["case.yaml", "not YAML"]),
        ("!!python/object:os.system {}", ["not YAML"]),
        ("- 1", ["case.yaml"]),
        ({"robot": {}}, ["'logs'", "missing"]),
        ({"logs": []}, ["'logs'"]),
        ({"logs": "a.csv"}, ["'logs'"]),
        ({"logs": [{"file": "a.csv"}], "robott": {}}, ["'robott'", "mean robot?"]),
        ({"logs": [{"file": "a.csv"}], "robot": 3}, ["'robot'"]),
        ({"logs": [{"file": "a.csv"}], "period": "fast"}, ["'period'"]),
        ({"logs": [{"file": "a.csv"}], "period": -1}, ["'period'"]),
        ({"logs": [{"flie": "a.csv"}]}, ["item 1", "'flie'", "mean file"]),
        ({"logs": [{"role": "fit"}]}, ["item 1", "'file'", "missing"]),
        ({"logs": [{"file": 3}]}, ["item 1", "'file'"]),
        ({"logs": [{"file": "a.csv", "role": "train"}]}, ["item 1", "'role'", "'train'"]),
        ({"logs": [{"file": "a.csv", "role": "holdout"}]}, ["'fit'"]),
        ({"logs": [{"file": "a.csv"}, {"file": "a.csv"}]}, ["case.yaml", "'a.csv'", "twice"]),
        ({"logs": [{"file": "a.csv", "repeats": "a.csv"}]}, ["case.yaml", "'a.csv'", "repeats"]),
        ({"logs": [{"file": "a.csv", "repeats": "z.csv"}]}, ["'a.csv'", "'z.csv'"]),
        ({"logs": [{"file": "z.csv"}]}, ["z.csv", "no such file"]),
        ({"logs": [{"file": "labels.json"}]}, ["labels.json", "ending"]),
    ],
)
def test_what_is_wrong_is_named(folder, page, parts):
    message = refusal(folder, page)
    for part in parts:
        assert part in message


def test_dates_and_serial_are_read_written_and_inherited(folder):
    page = {
        "serial": 7,
        "date": "2026-03-05",
        "logs": [{"file": "a.csv"}, {"file": "b.csv.gz", "date": "2026-03-06T14:30"}, {"file": "c.npz"}],
    }
    (folder / "case.yaml").write_text(yaml.safe_dump(page))
    case = read_case(folder)
    assert case.serial == "7" and [str(i.date.date()) for i in case.logs] == ["2026-03-05", "2026-03-06", "2026-03-05"]
    write_case(case, folder / "copy")
    back = read_case(folder / "copy")
    assert back.serial == "7" and [i.date for i in back.logs] == [i.date for i in case.logs]
    (folder / "case.yaml").write_text("serial: ''\nlogs: [{file: a.csv, date: 2026-03-05T10:00+02:00}]")
    write_case(read_case(folder), folder / "zone")
    assert read_case(folder / "zone").logs[0].date.utcoffset().total_seconds() == 7200


@pytest.mark.parametrize("date", ["5 March", "2026-13-01", 20260305.5, ["2026-03-05"]])
def test_what_is_no_date_is_refused_by_key(folder, date):
    assert "'date'" in refusal(folder, {"logs": [{"file": "a.csv", "date": date}]})


def test_held_out_logs_show_no_noise_and_take_no_log_from_the_fit():
    """Held-out logs decide nothing but the closure: neither do their repeats."""
    items = (
        CaseLog(one_log(1), "sweeps", "holdout", None, "a.csv"),
        CaseLog(one_log(2), "sweeps", "fit", "a.csv", "b.csv"),
        CaseLog(one_log(3), "sweeps", "holdout", "a.csv", "c.csv"),
        CaseLog(one_log(4), "chirp", "fit", None, "d.csv"),
        CaseLog(one_log(5), "chirp", "fit", "d.csv", "e.csv"),
    )
    case = Case("wearer", {}, items)
    assert [[item.file for item in group] for group in case.repeat_groups] == [["d.csv", "e.csv"]]
    assert [item.file for item in case.logs if case.is_copy(item)] == ["e.csv"]
    days = [datetime(2026, 3, day) for day in (1, 1, 2)]  # a repeat on another day may be another robot by then
    names = ("a", "b", "c")
    items = tuple(CaseLog(one_log(1), "a", "fit", "a" if n != "a" else None, n, d) for n, d in zip(names, days))
    case = Case("repeats", {}, items)
    assert [[item.file for item in group] for group in case.repeat_groups] == [["a", "b"]]
    assert [case.is_copy(item) for item in items] == [False, True, False]


SHORT = "caging:rest=0.1,approach=0.3,hold=0.1"
RUSTY = ("--effect", "tendon.capstan_friction:mu_phi=0.3@AF")


def measured(seed=0):
    """A log that no simulation wrote."""
    rng, kinds = np.random.default_rng(seed), ("tension_ref", "tension", "stroke", "speed_cmd")
    signals = {f"{kind}_{w}": rng.standard_normal(40) for kind in kinds for w in ("AF", "MF", "AE")}
    return Log(0.02 * np.arange(40), signals)


@pytest.fixture(scope="module")
def rusty(tmp_path_factory):
    """What `simulate --effect` writes: log.csv, nominal.csv and more."""
    folder = tmp_path_factory.mktemp("sim") / "rusty"
    assert run("simulate", SHORT, *RUSTY, "--out", folder).exit_code == 0
    return folder


@pytest.mark.parametrize("ending", [".csv", ".csv.gz", ".npz", ".parquet", ".mat", ".mcap"])
def test_every_format_carries_the_mark(tmp_path, rusty, ending):
    for name, mark in (("log.csv", CHANGED), ("nominal.csv", MODEL)):
        log = read_log(rusty / name)
        write_log(log, tmp_path / f"again{ending}")
        again = read_log(tmp_path / f"again{ending}")
        assert log.simulated == mark == again.simulated and again.equals(log) and "simulated" not in again.columns
    if ending == ".csv":  # other programs read it in a column
        table = np.genfromtxt(rusty / "nominal.csv", delimiter=",", names=True, deletechars="")
        assert np.all(table["simulated_[-]"] == MODEL)
    write_log(measured(), tmp_path / f"own{ending}")
    assert read_log(tmp_path / f"own{ending}").simulated == 0


def test_logs_of_python_and_of_diagrams_are_marked():
    robot = exo.load_robot()
    assert exo.simulate(robot, SHORT).simulated == exo.simulate(robot, SHORT, engine="drake").simulated == MODEL
    assert exo.simulate(robot.splice("tendon.slack"), SHORT).simulated == CHANGED


def test_a_folder_of_a_run_is_diagnosed_without_its_nominal_log(tmp_path, rusty):
    """Its log may stand for a robot, and its nominal log is the model: it is not held out."""
    case = read_case(rusty)
    assert [(item.file, item.role) for item in case.logs] == [("log.csv", "fit")]
    assert any("nominal.csv: left out, simulated by exodrake" in note for note in case.notes)
    assert any("log.csv: simulated by exodrake, not measured" in note for note in case.notes)
    write_case(case, tmp_path / "copy")
    for again in (read_case(tmp_path / "copy"), read_case(rusty / "log.csv")):
        assert again.logs[0].log.simulated == CHANGED
        assert any("simulated by exodrake, not measured" in note for note in again.notes)


def test_no_simulated_log_stands_for_the_robot_beside_measured_ones(tmp_path, rusty):
    for name in ("a.csv", "b.csv"):
        write_log(measured(), tmp_path / name)
    (tmp_path / "improved.csv").write_bytes((rusty / "log.csv").read_bytes())
    case = read_case(tmp_path)
    assert [(item.file, item.role) for item in case.logs] == [("a.csv", "fit"), ("b.csv", "holdout")]
    assert any(note.startswith("improved.csv: left out") for note in case.notes)
    (tmp_path / "case.yaml").write_text("logs: [{file: a.csv}, {file: improved.csv, role: holdout}]\n")
    with pytest.raises(InputError, match=r"'improved\.csv' is simulated by exodrake, 'a\.csv' is not"):
        read_case(tmp_path)


def test_a_folder_of_the_model_alone_is_refused(tmp_path):
    """Neither the nominal robot nor an improved robot file, simulated as it is, is a robot to diagnose."""
    robot = exo.load_robot().splice("tendon.capstan_friction", {"mu_phi": 0.3}, ["AF"])
    (tmp_path / "better.yaml").write_text(robot_text(robot, "improved"))
    for name, options in (("nominal", ()), ("improved", ("--robot", tmp_path / "better.yaml"))):
        assert run("simulate", SHORT, *options, "--out", tmp_path / name).exit_code == 0
        result = run("diagnose", tmp_path / name)
        assert result.exit_code == 2 and "they are the model, not the robot" in result.stderr


def test_a_column_of_that_name_that_is_no_mark_stays(tmp_path):
    log = measured().with_signals({"simulated": np.arange(40.0)}, {"simulated": "-"})
    write_log(log, tmp_path / "a.csv")
    assert read_log(tmp_path / "a.csv").equals(log) and read_log(tmp_path / "a.csv").simulated == 0
