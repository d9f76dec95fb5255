"""Logs that exodrake simulated: marked in files of every format, and never taken for the robot unasked."""

import numpy as np
import pytest
from command_line import run

import exodrake as exo
from exodrake.core.errors import InputError
from exodrake.data.case import read_case, write_case
from exodrake.data.formats import read_log, write_log
from exodrake.data.log import CHANGED, MODEL, Log
from exodrake.machines.robot_file import robot_text

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
