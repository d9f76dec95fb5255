"""`exodrake diagnose` and `exodrake demo`: files, exit status, what is printed. No diagnosis is run."""

import hashlib
import json

import numpy as np
import pytest
from command_line import run
from report_synthetic import UNKNOWN, VERDICTS, diagnosis

import exodrake.diagnosis.pipeline as pipeline
from exodrake.cli.diagnose import map_places
from exodrake.core.progress import Stage, stages
from exodrake.data.case import Case, CaseLog, read_case
from exodrake.data.formats import write_log
from exodrake.data.log import Log
from exodrake.diagnosis.result import NAMED
from exodrake.machines.robot_file import load_robot
from exodrake.simulation import protocols
from exodrake.simulation.protocols import on_machine
from exodrake.simulation.simulate import simulate


@pytest.fixture
def case(tmp_path):
    """A folder with one short log."""
    folder, time = tmp_path / "case", 0.02 * np.arange(100)
    folder.mkdir()
    kinds = ("tension_ref", "tension", "stroke")
    write_log(Log(time, {f"{k}_{w}": np.zeros(100) for k in kinds for w in ("AF", "MF", "AE")}), folder / "a.csv")
    return folder


@pytest.fixture
def answered(monkeypatch):
    """Puts a ready answer in place of the diagnosis."""

    def put(verdict):
        def ready(
            case, robot=None, progress=lambda *_: None, tried=None, discovers=None, answered=None, negligible=None
        ):
            for stage in Stage:
                progress(stage, "")
            return diagnosis(verdict)

        monkeypatch.setattr(pipeline, "diagnose", ready)

    return put


def test_log_of_another_machine_hints_at_the_option(tmp_path):
    write_log(Log(0.02 * np.arange(3), {"position": np.zeros(3)}), tmp_path / "other.csv")
    assert "--machine FOLDER or --robot NAME" in run("diagnose", tmp_path / "other.csv").output
    assert "--machine FOLDER" not in run("diagnose", "--robot", "exo_index", tmp_path / "other.csv").output


@pytest.mark.parametrize("verdict", VERDICTS)
def test_exit_status_is_0_whatever_the_verdict(case, answered, verdict):
    answered(verdict)
    result = run("diagnose", case)
    assert result.exit_code == 0, result.output
    assert verdict in result.output


def test_files_are_written(case, answered, tmp_path):
    answered(NAMED)
    result = run("diagnose", case, "--json", tmp_path / "a.json", "--out-robot", tmp_path / "r.yaml", "--jobs", 1)
    assert result.exit_code == 0, result.output
    answer = json.loads((tmp_path / "a.json").read_text())
    assert answer["verdict"] == "NAMED" and answer["effects"][0]["parameters"]["mu_phi"]["unit"] == "-"
    robot = load_robot(tmp_path / "r.yaml")
    assert robot["finger.kappa.MCP"] == pytest.approx(0.0712)
    assert robot["tendon.capstan_friction.mu_phi.AF"] == pytest.approx(0.3)
    assert robot["tendon.capstan_friction.mu_phi.AE"] == 0.0


def test_answer_states_command_and_hashes_and_no_absolute_path(case, answered, tmp_path):
    answered(NAMED)
    result = run("diagnose", case, f"--json={tmp_path / 'a.json'}", "--report", tmp_path / "r.html")
    assert result.exit_code == 0, result.output
    text = (tmp_path / "a.json").read_text()
    assert json.loads(text)["provenance"]["command"] == "exodrake diagnose case --json=a.json --report r.html"
    assert str(tmp_path) not in text + (tmp_path / "r.html").read_text()
    data = (case / "a.csv").read_bytes()
    assert read_case(case).hashes == {"a.csv": hashlib.sha256(data).hexdigest()}


def test_a_folder_takes_the_files_of_one_case_and_json_alone_is_printed(case, answered, tmp_path):
    answered(NAMED)
    result = run("diagnose", case, "--out", tmp_path / "answer", "--profile")
    table = result.output[result.output.index("processor") :]
    assert result.exit_code == 0 and all(stage.text in table for stage in Stage)
    assert "7,600 s" in table  # simulated time of the ready answer
    assert {path.name for path in (tmp_path / "answer").iterdir()} == {"diagnosis.json", "report.html", "improved.yaml"}
    assert json.loads(run("diagnose", case, "--json").stdout)["verdict"] == "NAMED"
    wrong = run("diagnose", "--json", case)
    assert wrong.exit_code == 2 and "ends in .json" in wrong.stderr


def test_a_folder_of_cases_stands_for_them_and_names_that_are_alike_get_their_folders_name(case, tmp_path):
    for folder in ("x", "y"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "log.csv").write_bytes((case / "a.csv").read_bytes())
    logs = (str(tmp_path / "x" / "log.csv"), str(tmp_path / "y" / "log.csv"))
    assert [place.name for place in map_places(logs, tmp_path).values()] == ["x_log", "y_log"]
    assert [place.name for place in map_places((str(tmp_path),), tmp_path).values()] == ["case", "x", "y"]
    refused = run("check", tmp_path)
    assert refused.exit_code == 2 and "folder of cases" in refused.stderr and "case" in refused.stderr
    assert run("diagnose", tmp_path, "--report", tmp_path / "r.html").exit_code == 2


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--json", "gone/a.json"),
        ("--report", "gone/r.html"),
        ("--out-robot", "gone/r.yaml"),
        ("--robot", "no_such_robot.yaml"),
    ],
)
def test_bad_option_ends_with_2_before_the_work_and_writes_nothing(case, monkeypatch, tmp_path, option, value):
    monkeypatch.setattr(pipeline, "diagnose", lambda *a, **k: pytest.fail("worked"))
    target = value if option == "--robot" else tmp_path / value
    result = run("diagnose", case, "--json", tmp_path / "answer.json", option, target)
    assert result.exit_code == 2 and value.split("/")[0].rstrip(".") in result.output
    assert len(result.output.strip().splitlines()) == 1
    assert not (tmp_path / "answer.json").exists()


def test_bad_log_names_file_and_column(case):
    text = (case / "a.csv").read_text().replace("stroke_MF", "strike_MF")
    (case / "a.csv").write_text(text)
    result = run("diagnose", case)
    assert result.exit_code == 2 and "a.csv" in result.output and "MF" in result.output


def test_an_error_in_the_report_loses_no_answer(case, answered, tmp_path, monkeypatch):
    import exodrake.report.diagnosis_html as diagnosis_html

    def fails(*_):
        raise RuntimeError("ink is out")

    answered(NAMED)
    monkeypatch.setattr(diagnosis_html, "report_html", fails)
    result = run("diagnose", case, "--json", tmp_path / "a.json", "--report", tmp_path / "r.html")
    assert isinstance(result.exception, RuntimeError)
    assert "NAMED" in result.output
    assert {path.name for path in tmp_path.iterdir()} == {"case", "a.json"}


@pytest.mark.parametrize("ending", [KeyboardInterrupt, RuntimeError])
def test_an_answer_is_kept_before_a_missing_law_is_sought(case, tmp_path, monkeypatch, ending):
    """The search for a law is interrupted: answer, robot file and report are there, and the summary is printed."""

    def interrupted_search(
        case, robot=None, progress=lambda *_: None, tried=None, discovers=None, answered=None, negligible=None
    ):
        answered(diagnosis(UNKNOWN))
        raise ending

    monkeypatch.setattr(pipeline, "diagnose", interrupted_search)
    files = {"--json": "a.json", "--out-robot": "r.yaml", "--report": "r.html"}
    result = run("diagnose", case, *(x for o, name in files.items() for x in (o, tmp_path / name)))
    assert result.exit_code != 0 and "UNKNOWN" in result.output and "wrote" in result.output
    assert json.loads((tmp_path / "a.json").read_text())["verdict"] == "UNKNOWN"
    assert load_robot(tmp_path / "r.yaml") and "no effect of the library" in (tmp_path / "r.html").read_text()


def test_a_search_for_a_law_that_fails_becomes_a_note(monkeypatch):
    def fails(*_, **__):
        raise NameError("name 'force' is not defined")

    robot, kept = load_robot("tendon_sheath"), []
    motion = on_machine(protocols.random_motion, robot, duration=4.0, seed=1, fastest=1.0)
    items = (CaseLog(simulate(robot, motion, seed=1), "random", "fit", None, "a.csv"),)
    monkeypatch.setattr(pipeline, "discover", fails)
    sheath = Case("sheath", {}, items, robot.machine.frame)
    found = pipeline.diagnose(sheath, robot, discovers=lambda _: True, answered=kept.append)
    assert found.verdict == kept[0].verdict and found.missing_law is None
    assert "the search for a missing law failed (NameError: name 'force' is not defined)" in found.notes


def test_bar_only_goes_forward(monkeypatch):
    seen = []
    monkeypatch.setattr("rich.progress.Progress.update", lambda *_, completed, **__: seen.append(completed))
    with stages() as report:
        for stage in [*Stage, *(Stage.FIT,) * 30]:
            report(stage, "")
    assert seen == sorted(seen) and seen[-1] < 100


def test_demo_refuses_a_folder_with_an_earlier_demo(tmp_path):
    (tmp_path / "case").mkdir()
    result = run("demo", "--out", tmp_path)
    assert result.exit_code == 2 and "earlier demo" in result.output


@pytest.mark.parametrize(("verdict", "words"), [(NAMED, "found: the verdict was NAMED"), (UNKNOWN, "number 1 of 3")])
def test_demo_reveals_the_label_and_says_if_it_was_found(tmp_path, capsys, verdict, words):
    from exodrake.cli.blind import COMMITMENT, LABELS, case_plan, reveal
    from exodrake.reference.answers import write_committed

    truth = {"id": "tendon.capstan_friction", "block": "tendon", "wires": ["AF"], "joints": [], "exact": False}
    assert case_plan(3) == case_plan(3) and len({case_plan(seed).ids for seed in range(20)}) > 8
    truth |= {"parameters": {"mu_phi": 0.3}, "gap": 5.0}
    write_committed({"case": {"kind": "single", "effects": [truth]}}, tmp_path / LABELS, tmp_path / COMMITMENT)
    reveal(tmp_path, diagnosis(verdict))
    text = capsys.readouterr().out
    assert "capstan_friction on AF" in text and words in text and "law has another form" in text
