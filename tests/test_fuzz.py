"""No input ends in a traceback or in half a file: every reader and command, on files spoilt in every way we know."""

from contextlib import suppress

import numpy as np
import pytest
import yaml
from fuzzing import bounded, in_time, packed, run, spoilt_bytes, spoilt_page, spoilt_table
from hypothesis import given, strategies as st

import exodrake as exo
from exodrake.core import processes as child
from exodrake.data.formats import formats
from exodrake.identification.kinematics.markers import Faults, Hand, c3d_bytes, csv_bytes, read_markers, synthesise

ROBOT = exo.load_robot()
LOG = exo.simulate(ROBOT, exo.grasp("caging", ROBOT)).rows(slice(60, 165))


def text_of(log: exo.Log) -> str:
    from exodrake.data.formats.csv import write

    return write(log).decode()


FULL, SHORT = text_of(LOG), text_of(LOG.rows(slice(0, 6)))
HAND = synthesise(Hand(), Faults(noise=3e-4), 3.0, 50.0, 3)[0]
MARKERS, C3D = csv_bytes(HAND).decode(), c3d_bytes(HAND)


@pytest.fixture
def undrawn(monkeypatch):
    """Commands without what only draws, and a diagnosis that ends when its case is read and its noise known."""
    import exodrake.cli.simulate as command
    import exodrake.diagnosis.pipeline as pipeline
    import exodrake.diagrams.meshcat as viewer

    def stop(*_):
        raise exo.InputError("read")

    monkeypatch.setattr(command, "make_files", lambda *_: {})
    monkeypatch.setattr(viewer, "recording_html", lambda *_, **__: "")
    monkeypatch.setattr(pipeline, "isolate", stop)


@bounded(8)
@given(data=spoilt_table(FULL), gz=st.booleans(), command=st.sampled_from(["diagnose", "export", "simulate", "show"]))
def test_spoilt_logs(place, undrawn, data, gz, command):
    folder = place()
    log = folder / ("log.csv.gz" if gz else "log.csv")
    log.write_bytes(packed(data) if gz else data)
    words = {
        "diagnose": ["diagnose", log],
        "export": ["export", log, "--out", folder / "out.npz"],
        "simulate": ["simulate", "--reference", log, "--out", folder / "out"],
        "show": ["show", log, "--out", folder / "out.html"],
    }
    said = run(*words[command])
    left = sorted(path.name for path in folder.iterdir() if path != log)
    refused = "error: " in said
    assert not left if refused else left, said
    assert not refused or "log" in said or said == "error: read\n"


@bounded(6)
@given(data=st.data(), ending=st.sampled_from(sorted(formats())))
def test_spoilt_binary_files(place, data, ending):
    folder = place()
    exo.write_log(LOG.rows(slice(0, 4)), folder / f"log{ending}")
    spoilt = data.draw(spoilt_bytes((folder / f"log{ending}").read_bytes()))
    (folder / f"log{ending}").write_bytes(spoilt)
    said = run("export", folder / f"log{ending}", "--out", folder / "out.csv.gz")
    assert ("error: " in said) != (folder / "out.csv.gz").exists()


# no variant parts: each takes a minute to compile
CASE = {
    "name": "wearer", "robot": {"tendon": {"k": 2500}}, "period": 0.02,
    "logs": [{"file": "a.csv", "role": "fit"}, {"file": "b.csv", "role": "holdout", "protocol": "x"}],
}  # fmt: skip
SCENARIO = {
    "protocol": "caging:hold=0.2", "parameters": {"tendon.k": 2500.0}, "parts": [], "seed": 1,
    "effects": {"tendon.slack": {"length": {"AF": 0.001}}}, "quantisation": True, "engine": "compiled",
}  # fmt: skip
CHANGED = {
    "base": "exo_index", "parameters": {"tendon": {"k": {"value": 2600, "unit": "N/m", "range": [1000, 14000]}}},
    "effects": {"tendon.slack": {"length": {"AF": 0.001}}}, "parts": [],
    "limits": {"F_max": {"AF": 12}}, "grasps": {"caging": {"AF": 7.0, "MF": 0.3, "AE": 0.3}}, "notes": "x",
}  # fmt: skip


@bounded(6)
@given(page=spoilt_page(CASE))
def test_spoilt_cases(place, undrawn, page):
    folder = place()
    for name in ("a.csv", "b.csv"):
        (folder / name).write_text(FULL)
    (folder / "case.yaml").write_bytes(page)
    run("diagnose", folder, "--json", folder / "out.json")
    assert not (folder / "out.json").exists()


@bounded(6)
@given(page=spoilt_page(CHANGED), command=st.sampled_from(["simulate", "effects", "draw", "show"]))
def test_spoilt_robots(place, undrawn, page, command):
    folder = place()
    (folder / "robot.yaml").write_bytes(page)
    (folder / "log.csv").write_text(SHORT)
    words = {
        "simulate": ["simulate", "caging:hold=0.2", "--out", folder / "out"],
        "effects": ["effects", "tendon.slack", "--json"],
        "draw": ["draw", "--out", folder / "out.svg"],
        "show": ["show", folder / "log.csv", "--out", folder / "out.html"],
    }
    said = run(*words[command], "--robot", folder / "robot.yaml")
    assert "error: " not in said or len(list(folder.iterdir())) == 2


@bounded(6)
@given(page=spoilt_page(SCENARIO))
def test_spoilt_scenarios(place, undrawn, page):
    folder = place()
    (folder / "s.yaml").write_bytes(page)
    said = run("simulate", "--scenario", folder / "s.yaml", "--out", folder / "out")
    assert ("error: " in said) != (folder / "out" / "log.csv").exists()


@bounded(4)
@given(data=spoilt_table(MARKERS), names=spoilt_page({"base": ["B1", "B2", "B3"], "tip": "D2", "thumb": ["T1"]}))
def test_spoilt_markers(place, data, names):
    folder = place()
    (folder / "hand.csv").write_bytes(data)
    (folder / "names.yaml").write_bytes(names)
    run("identify", "kinematics", folder / "hand.csv", "--out", folder / "out", "--markers", folder / "names.yaml")


@bounded(4)
@given(data=spoilt_bytes(C3D))
def test_spoilt_motion_capture(place, monkeypatch, data):
    monkeypatch.setattr(child, "CPU_TIME", 1.0)  # many never end
    folder = place()
    (folder / "hand.c3d").write_bytes(data)
    with in_time(), suppress(exo.InputError):
        assert read_markers(folder / "hand.c3d").names


@bounded(4)
@given(data=spoilt_table(SHORT), junk=st.binary(max_size=40))
def test_spoilt_estimators_and_training_logs(place, data, junk):
    folder = place()
    (folder / "log.csv").write_bytes(data)
    (folder / "e.npz").write_bytes(junk)
    assert "error: " in run("estimate", folder / "log.csv", "--estimator", folder / "e.npz", "--out", folder / "x.csv")
    assert "error: " in run("train", folder / "log.csv", "--out", folder / "new.npz")
    assert len(list(folder.iterdir())) == 2


LETTERS = st.characters(exclude_categories=["Cc", "Cs", "Zl", "Zp"])  # a shell passes no NUL
WORDS = st.one_of(
    st.text(LETTERS, max_size=6),
    st.sampled_from(["caging", "chirp:low=1e9", "caging:hold=-1", "x" * 5000, "@", ":", "=", "60mm"]),
)


@bounded(6)
@given(
    words=st.lists(WORDS, max_size=2),
    command=st.sampled_from(["simulate", "grasp", "effects", "diagnose", "export", "draw", "show", "analyse"]),
    option=st.sampled_from(
        ["--set", "--effect", "--part", "--robot", "--scenario", "--size", "--out", "--at", "--json"]
    ),
    value=WORDS,
)
def test_any_words_for_a_command(place, undrawn, monkeypatch, words, command, option, value):
    monkeypatch.chdir(place())
    if command == "diagnose" and option == "--out":
        option = "--report"  # of several cases those that cannot be read end with status 1
    if command == "analyse" and option not in ("--robot", "--set", "--effect", "--part"):
        option = "--part"  # what is valid takes seconds
    said = run(command, *words, option, value)
    assert said or command == "draw"


@pytest.mark.parametrize("rows", [1, 2, 5, 25, 49])
def test_a_log_too_short_to_diagnose_is_refused_by_name(tmp_path, rows):
    exo.write_log(LOG.rows(slice(0, rows)), tmp_path / "short.csv")
    said = run("diagnose", tmp_path / "short.csv", "--json", tmp_path / "x.json")
    assert "short.csv" in said and f"{rows} frames" in said and not (tmp_path / "x.json").exists()


def test_an_hour_is_refused_before_the_work(tmp_path):
    from exodrake.diagnosis.checks.compare import check_case

    hour = exo.Log(0.02 * np.arange(180_000), {name: np.zeros(180_000) for name in LOG.columns})
    case = exo.Case("hour", {}, (exo.CaseLog(hour, "x", "fit", None, "hour.csv"),))
    with pytest.raises(exo.InputError, match=r"hour: 180000 frames"):
        check_case(case, ROBOT.machine)


def test_the_order_of_columns_does_not_matter():
    from exodrake.diagnosis.problem import make_problem

    def problem(log):
        logs = tuple(exo.CaseLog(log, "x", role, None, f"{role}.csv") for role in ("fit", "holdout"))
        return make_problem(exo.Case("c", {}, logs), ROBOT)

    a, b = problem(LOG), problem(LOG.only(reversed(LOG.columns)))
    assert a.columns == b.columns
    np.testing.assert_array_equal(a.fit[0].reference, b.fit[0].reference)
    np.testing.assert_array_equal(a.fit[0].measured, b.fit[0].measured)
    np.testing.assert_array_equal(a.noise_std, b.noise_std)


def test_a_case_of_another_robot_is_refused(tmp_path):
    (tmp_path / "log.csv").write_text(FULL.replace("_MF", "_EF"))
    assert "_MF' is missing" in run("diagnose", tmp_path / "log.csv")
    (tmp_path / "case.yaml").write_text(yaml.safe_dump({"period": 0.01, "logs": [{"file": "b.csv"}]}))
    exo.write_log(exo.Log(LOG.time / 2, LOG.signals), tmp_path / "b.csv")
    assert "frames of 0.01 s" in run("diagnose", tmp_path)
