"""Inputs that did harm and YAML that is more than plain data: each is refused in one short sentence, in seconds."""

import gzip
import io
import itertools
import math
import os
import time
from pathlib import Path

import numpy as np
import pytest
from fuzzing import packed, run
from hypothesis import given, settings, strategies as st

import exodrake as exo
from exodrake.core import files, processes as child
from exodrake.core.errors import MAX_MESSAGE, InputError
from exodrake.core.parallel import attempt
from exodrake.core.schema import MAX_BYTES, dump_yaml, parse_json, parse_yaml
from exodrake.data import case, import_log as mapping, log as log_module
from exodrake.data.case import read_case
from exodrake.data.formats import csv
from exodrake.data.tables import list_columns
from exodrake.identification.kinematics import markers
from exodrake.identification.kinematics.markers import Faults, Hand, c3d_bytes, read_markers, synthesise
from exodrake.machines import robot_file
from exodrake.monitor.watcher import Tail
from exodrake.simulation import scenario

HERE = Path(__file__).parent / "spoilt"
C3D = c3d_bytes(synthesise(Hand(), Faults(noise=3e-4), 3.0, 50.0, 3)[0])  # 150 frames of 14 points of 16 bytes
COUNT = 820  # place of a size in that file's parameters
NAMES = ("tension_ref_AF", "tension_AF", "stroke_AF")


def log(rows: int = 30) -> exo.Log:
    return exo.Log(0.02 * np.arange(rows), {name: np.linspace(0.0, 1e-3, rows) for name in NAMES})


def refusal(function, *arguments, **options) -> str:
    with pytest.raises(exo.InputError) as caught:
        function(*arguments, **options)
    said = str(caught.value)
    assert len(said) <= MAX_MESSAGE and said.isprintable()
    return said


def test_a_mat_file_that_crashes_the_reader_costs_itself_alone(tmp_path):
    exo.write_log(log(), tmp_path / "good.mat")
    assert "segv.mat" in run("export", HERE / "segv.mat", "--out", tmp_path / "x.csv")
    assert exo.read_log(tmp_path / "good.mat").equals(log()) and not (tmp_path / "x.csv").exists()


@pytest.mark.parametrize("name", ["hang", "crash", "cut"])
def test_c3d_files_that_hang_crash_or_end_early_are_refused(tmp_path, monkeypatch, name):
    monkeypatch.setattr(child, "CPU_TIME", 4.0)
    damaged = C3D[:COUNT] + b"\xff\xff\xff\x7f" + C3D[COUNT + 4 :]
    data = {"hang": (HERE / "hang.c3d").read_bytes(), "crash": damaged, "cut": C3D[: -126 * 14 * 16]}[name]
    (tmp_path / f"{name}.c3d").write_bytes(data)
    said = refusal(read_markers, tmp_path / f"{name}.c3d")
    assert f"{name}.c3d" in said and (name != "cut" or ("24 frames" in said and "150" in said))
    (tmp_path / "good.c3d").write_bytes(C3D)
    assert len(read_markers(tmp_path / "good.c3d").time) == 150


def test_a_call_that_does_not_end_or_takes_all_memory_is_ended(monkeypatch):
    monkeypatch.setattr(child, "CPU_TIME", 1.0)
    monkeypatch.setattr(child, "PATIENCE", 2.0)
    assert "does not come to an end" in refusal(child.in_child, time.sleep, 100, source="a", size=0)
    monkeypatch.setattr(child, "PATIENCE", 500.0)
    assert "does not come to an end" in refusal(child.in_child, sum, itertools.count(), source="a", size=0)
    assert "memory" in refusal(child.in_child, bytearray, 2 * child.MEMORY, source="a", size=0)
    assert "crashes" in refusal(child.in_child, os._exit, 3, source="a", size=0)
    assert child.in_child(max, 1, 2, source="a", size=0) == 2


def test_too_many_rows_and_too_many_bytes_are_refused_before_they_are_parsed(tmp_path, monkeypatch):
    rows = b"time [s]," + ",".join(f"{name} [N]" for name in NAMES[:2]).encode() + b"\n" + b"0.02,1,1\n" * 7_000_000
    (tmp_path / "rows.csv.gz").write_bytes(gzip.compress(rows, 1))
    assert "samples" in refusal(exo.read_log, tmp_path / "rows.csv.gz")
    assert "columns" in refusal(list_columns, b"1," * 30_000, "x.csv")
    monkeypatch.setattr(csv, "MAX_BYTES", 10**6)
    monkeypatch.setattr(files, "MAX_BYTES", 10**6)
    assert "larger than 1 MB" in refusal(exo.read_log, tmp_path / "rows.csv.gz")
    (tmp_path / "large.csv").write_bytes(rows[: 10**6 + 1])
    assert "larger than 1 MB" in refusal(exo.read_log, tmp_path / "large.csv")


def test_numbers_that_compress_well_fill_no_memory(tmp_path, monkeypatch):
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    parquet.write_table(arrow.table({"time [s]": arrow.nulls(6 * 10**8)}), tmp_path / "a.parquet")  # 4.8 GB as numbers
    assert (tmp_path / "a.parquet").stat().st_size < 2 * 10**6
    assert "samples" in refusal(exo.read_log, tmp_path / "a.parquet")
    monkeypatch.setattr(log_module, "MAX_SAMPLES", 10**5)
    np.savez_compressed(tmp_path / "a.npz", np.zeros(2 * 10**5))
    assert "samples" in refusal(exo.read_log, tmp_path / "a.npz")


@pytest.mark.parametrize("command", ["export", "import", "simulate", "diagnose", "identify"])
def test_pipes_and_devices_are_refused(tmp_path, command):
    pipe, out = tmp_path / "p.csv", tmp_path / "x.csv"
    os.mkfifo(pipe)
    words = {
        "export": [pipe, "--out", out],
        "import": ["/dev/zero", "--map", pipe, "--out", out],
        "simulate": ["--scenario", pipe],
        "diagnose": [pipe],
        "identify": ["kinematics", pipe],
    }
    assert "error: " in run(command, *words[command]) and not out.exists()
    assert "a pipe" in refusal(next, Tail(pipe, exo.load_robot().machine).poll())


@pytest.mark.parametrize("value", ["1e300", "-1e13", "1e400", "9" * 400])
def test_values_beyond_any_signal_are_refused(tmp_path, value):
    (tmp_path / "a.csv").write_text(f"time [s],tension_AF [N]\n0,1\n0.02,{value}\n")
    said = refusal(exo.read_log, tmp_path / "a.csv")
    assert "'tension_AF', row 2" in said


@pytest.mark.parametrize("way", ["name", "absolute", "link", "link without case.yaml"])
def test_logs_outside_the_folder_of_their_case_are_read_only_if_allowed(tmp_path, way):
    folder, outside = tmp_path / "case", tmp_path / "secret.csv"
    folder.mkdir()
    exo.write_log(log(), outside)
    name = {"name": "../secret.csv", "absolute": str(outside)}.get(way, "link.csv")
    if name == "link.csv":
        (folder / name).symlink_to(outside)
    if way != "link without case.yaml":
        (folder / "case.yaml").write_text(f"logs: [{{file: {name}}}]")
    assert "outside" in refusal(read_case, folder)
    assert len(read_case(folder, allow_outside=True).logs) == 1
    assert "--allow-outside" in run("diagnose", folder)
    assert "is missing" in run("diagnose", folder, "--allow-outside")


@pytest.mark.parametrize("text", ["a: &a [*a]", "a: &a {}\nb: *a", "[" * 99, "a: 1\na: 2", "!!python/name:os.system x"])
@pytest.mark.parametrize("kind", ["robot", "scenario", "case", "mapping", "markers"])
def test_every_yaml_file_is_plain_data(tmp_path, text, kind):
    page = tmp_path / "case.yaml"
    page.write_text(text)
    (tmp_path / "log.csv.gz").write_bytes(packed(b"time [s],B1_x [mm],B1_y [mm],B1_z [mm]\n0,1,1,1\n"))
    (tmp_path / "log.csv").write_bytes(b"time [s],B1_x [mm],B1_y [mm],B1_z [mm]\n0,1,1,1\n")
    words = {
        "robot": ["robot", page],
        "scenario": ["simulate", "--scenario", page],
        "case": ["diagnose", tmp_path],
        "mapping": ["import", tmp_path / "log.csv.gz", "--map", page, "--out", tmp_path / "x.csv"],
        "markers": ["identify", "kinematics", tmp_path / "log.csv", "--markers", page],
    }
    said = run(*words[kind])
    assert "case.yaml, line" in said, said


def test_names_are_neither_obeyed_by_the_terminal_nor_read_as_markup(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = run("export", ("[red]a\x1b[31m\r\nb[/red]" + "c" * 100) * 2 + ".csv", "--out", "x.npz")
    assert "[red]a\\x1b[31m\\r\\nb[/red]" in said and "\x1b" not in said and len(said) < MAX_MESSAGE + 10


def test_no_answer_says_where_on_this_machine_it_was_made(tmp_path):
    """Notes of a case go into its answer, and so does the traceback of a failure."""
    (tmp_path / "case").mkdir()
    for name in ("a.csv", "b.csv"):
        exo.write_log(log().rows(np.r_[0:20, 25:30]), tmp_path / "case" / name)  # five frames are missing
    notes = read_case(tmp_path / "case").notes
    assert len(notes) > 2 and not [note for note in notes if str(tmp_path) in note]
    _, reason, trace = attempt(read_case, (tmp_path / "case", ("glow",)))
    assert "case.py" in trace and 'File "/' not in trace and reason


def numpy_bytes(kind: str) -> bytes:
    """A pickle that would make a file, 10^12 items of no bytes in 128 bytes, and 5 10^7 bytes in 50 kB."""
    stream = io.BytesIO()
    if kind == "pickle":
        np.save(stream, np.array([Path("made")], dtype=object), allow_pickle=True)
    elif kind == "no bytes":
        np.lib.format.write_array_header_1_0(
            stream, {"descr": "|V0", "fortran_order": False, "shape": (10**12,)}
        )  # fmt: skip
    else:
        np.savez_compressed(stream, a=np.zeros(50_000_000, "u1"))
    return stream.getvalue()


@pytest.mark.parametrize(("kind", "word"), [("pickle", "allow_pickle"), ("no bytes", "samples"), ("bytes", "samples")])
def test_numpy_files_hold_no_pickles_and_no_more_than_a_log(kind, word):
    assert word in refusal(list_columns, numpy_bytes(kind), "x.npz" if kind == "bytes" else "x.npy")


SCHEMAS = [module.SCHEMA for module in (robot_file, scenario, case, mapping, markers)]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 0.001), ("1:30", "1:30"), ("no", "no"), ("on", "on"), ("010", 10), ("0o17", 15), ("0x1F", 31),
        (".inf", math.inf), ("-.INF", -math.inf), ("1_000", "1_000"), ("2020-01-01", "2020-01-01"), ("~", None),
        ("true", True), ("'1'", "1"), ("+.5e1", 5.0), ("1e999", "1e999"), ("<<", "<<"), ("", None), ("# none", None),
    ],
)  # fmt: skip
def test_scalars_are_those_of_yaml_1_2(text, value):
    found = parse_yaml(text.encode(), "f.yaml")
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"a: &x 1\nb: 2", ["line 1", "anchors"]),
        (b"a: 1\nb: *x", ["line 2", "anchors"]),
        (b"a: !!float 1", ["tag"]),
        (b"a: 1\n'a': 2", ["line 2", "'a'", "twice"]),
        (b"a: {b: 1, b: 1}", ["'b'", "twice"]),
        (b"? [1]\n: 2", ["no name"]),
        (b"[" * 10**6, ["nested"]),
        (b"a: 1\n---\nb: 1", ["second document"]),
        (b"x" * (MAX_BYTES + 1), ["bytes"]),
        (b'"\\a": 1\n"\\a": 2', ["'\\x07'"]),
    ],
)
def test_more_than_plain_data_is_refused(data, words):
    with pytest.raises(InputError) as caught:
        parse_yaml(data, "f.yaml")
    assert "f.yaml" in str(caught.value) and all(word in str(caught.value) for word in words)


KEYS = ("machine", "base", "parameters", "effects", "parts", "limits", "grasps", "tolerances", "logs", "file", "period")
INNER_KEYS = ("time", "columns", "name", "unit", "scale", "value", "range", "tip", "seed", "engine", "transform")
SCALARS = st.one_of(
    st.none(), st.booleans(), st.floats(), st.integers(), st.text(), st.just(10**400), st.just("x" * 999)
)
CONTENT = st.recursive(
    SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.one_of(st.sampled_from(KEYS + INNER_KEYS), st.text()), inner, max_size=4),
    ),
    max_leaves=15,
)


@settings(max_examples=100, deadline=None)
@given(content=CONTENT, schema=st.sampled_from(SCHEMAS), source=st.text(max_size=400))
def test_any_content_is_taken_or_refused_in_a_short_printable_sentence(content, schema, source):
    try:
        schema(content, source)
    except InputError as problem:
        assert len(str(problem)) <= MAX_MESSAGE and str(problem).isprintable()


FINITE = st.one_of(st.none(), st.booleans(), st.floats(allow_nan=False), st.integers(), st.text())
PLAIN = st.recursive(
    FINITE, lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(), inner, max_size=4))
)


@settings(max_examples=100, deadline=None)
@given(content=st.dictionaries(st.text(), PLAIN, max_size=4))
def test_what_is_dumped_is_what_is_parsed(content):
    assert parse_yaml(dump_yaml(content).encode(), "f.yaml") == content


def test_json_may_be_larger_than_yaml():
    """An answer of many frames is; a robot file is not."""
    assert parse_json(b"[" + b" " * MAX_BYTES + b"]", "answer.json") == []
