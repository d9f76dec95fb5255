"""No foreign recording ends in a traceback or in half a file: every reader, on files spoilt in every way we know."""

import io
import json
import sqlite3
from contextlib import suppress

import h5py
import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest
import yaml
from bags import BAG, BAG_MAP, json_mcap, sqlite_bag
from fuzzing import JUNK, bounded, json_bytes, run, spoilt_bytes, spoilt_page, spoilt_table
from hypothesis import given, strategies as st
from report_synthetic import diagnosis
from scipy.io import savemat
from small_recordings import SETS, made

import exodrake as exo
from exodrake.analysis.robustness import within_intervals
from exodrake.core.schema import read_json
from exodrake.data.formats import formats
from exodrake.diagnosis.fleet import Row, read_row, sort_rows, table_bytes
from exodrake.report.fleet import fleet_html
from studies.real_machines.recordings import READERS

TIME = 0.02 * np.arange(6)
LOG = exo.Log(TIME, {"stroke_AF": np.linspace(0.0, 5e-3, 6), "tension_AF": np.array([1, 2, np.nan, 4, 5, 6])})
TEXT = "time [s],stroke_AF [m],tension_AF [N]\n" + "".join(f"{t},{t / 9},{t * 9}\n" for t in TIME)
MAPPING = {
    "time": {"column": "time [s]", "unit": "s"}, "hold": 1, "separator": ",", "decimal": ".", "skip": 0,
    "columns": {"tension_AF [N]": {"name": "tension_AF", "unit": "N", "scale": 2, "offset": 0}},
}  # fmt: skip
TREE = {"run": {"t": TIME.tolist(), "q": np.outer(TIME, [1.0, 2.0]).tolist(), "note": "left"}, "k": 2.0}
TREE_MAP = {"time": {"column": "run.t"}, "columns": {"run.q[1]": {"name": "angle_elbow", "unit": "rad"}}}
FEATURE = {"dtype": "float32", "shape": [2], "names": ["wrist.pos", "elbow.pos"]}
INFO = {"fps": 50, "features": {"action": FEATURE, "observation.state": FEATURE}}
EPISODE = {"action": [[t, 2 * t] for t in TIME], "observation.state": [[t, t] for t in TIME], "timestamp": list(TIME)}
EPISODE |= {"episode_index": [0, 0, 0, 1, 1, 1]}
VALUES = [
    np.nan, np.inf, None, 10**30, "x", b"\xff", True, 1e308, [], [1.0], [[1.0], [2.0, 3.0]], np.zeros((2, 3, 4)), 3j,
    np.zeros(0), np.array(["a", "b"]), np.float16(1.0), np.arange(6), np.arange(12.0).reshape(6, 2),
    np.array([(1, 2.0)], [("a", "i4"), ("b", "f8")]), np.array(1 + 2j), np.array(["2020-01-01"], "M8[s]"),
]  # fmt: skip
ROWS = [None, float("nan"), float("inf"), 1e300, "x", True, [1.0], [1.0, None], [[1.0]], [], {"a": 1}, b"x", -1]
STATES = {f"/joint_states:position[{j}]": {"name": f"angle_{j}", "unit": "rad"} for j in ("wrist", "elbow")}
COLUMNS = {
    "topics": ["id", "name", "type"], "messages": ["topic_id", "timestamp", "data"],
    "message_definitions": ["topic_type", "encoded_message_definition"],
}  # fmt: skip


def mapped(key, kind="stroke_AF", unit="m", **time):
    return {"time": time or {"period": 0.02}, "columns": {key: {"name": kind, "unit": unit}}}


# Each writes one kind of recording into a folder: its name, its mapping (None to import it without), further options.
def text(draw, folder):
    name = f"drive{draw(st.sampled_from(['.csv', '.txt', '.dat', '.csv.gz', '']))}"
    (folder / name).write_bytes(draw(spoilt_table(TEXT)))
    return name, MAPPING


def own_format(draw, folder):
    name = f"d{draw(st.sampled_from(sorted(formats())))}"
    exo.write_log(LOG, folder / name)
    (folder / name).write_bytes(draw(spoilt_bytes((folder / name).read_bytes())))
    return name, mapped("stroke_AF" if name == "d.mat" else "stroke_AF [m]")


def ros_bag(draw, folder):
    (folder / "bag.mcap").write_bytes(draw(spoilt_bytes(BAG)))
    return "bag.mcap", BAG_MAP


def json_tree(draw, folder):
    (folder / "run.json").write_bytes(draw(spoilt_page(TREE, json_bytes)))
    return "run.json", TREE_MAP


def json_lines(draw, folder):
    rows = [{"run": {"t": t, "q": [t, 2 * t]}} for t in TIME.tolist()]
    lines = [draw(spoilt_page(row, json_bytes)) if k < 2 else json_bytes(row) for k, row in enumerate(rows)]
    name = f"run{draw(st.sampled_from(['.jsonl', '.ndjson']))}"
    (folder / name).write_bytes(b"\n".join(lines))
    return name, TREE_MAP


def json_messages(draw, folder):
    def tree(one):
        return st.lists(one, max_size=3) | st.dictionaries(st.sampled_from(["q", "name", "sec", "timestamp"]), one)

    leaf = st.none() | st.floats() | st.integers() | st.text(max_size=4)
    state = draw(st.sampled_from(VALUES).map(str) | st.recursive(leaf, tree))
    whole = {"q": [1.0, 2.0], "name": ["wrist", "elbow"], "timestamp": {"sec": 1, "nsec": 0}}
    (folder / "a.mcap").write_bytes(json_mcap([("/s", 0.0, whole), ("/s", 0.1, state), ("/s", 0.2, whole)]))
    field = draw(st.sampled_from(["q", "q[0]", "q[wrist]", "q.name", "timestamp.sec", "[0]", "q]["]))
    mapping = {"columns": mapped(f"/s:{field}", "angle_wrist", "rad")["columns"]}
    return "a.mcap", mapping | {"stamp": draw(st.sampled_from(["log", "header"]))}


def matlab_tree(draw, folder):
    stream = io.BytesIO()
    tree = {"run": {"t": TIME, "q": np.outer(TIME, [1.0, 2.0]), "odd": draw(st.sampled_from(VALUES[4:]))}}
    savemat(stream, tree, do_compression=draw(st.booleans()))
    content = stream.getvalue()
    (folder / "run.mat").write_bytes(draw(spoilt_bytes(content)) if draw(st.booleans()) else content)
    return "run.mat", TREE_MAP


def hdf5(draw, folder):
    """A group with time, angles and something odd, as MATLAB 7.3 writes it or as h5py does."""
    name = draw(st.sampled_from(["run.h5", "run.hdf5", "run.mat"]))
    with h5py.File(folder / name, "w", userblock_size=512 if name == "run.mat" else 0) as file:
        group = file.create_group("run")
        group["t"] = TIME[None] if name == "run.mat" else TIME
        group["q"] = np.outer([1.0, 2.0], TIME)
        with suppress(TypeError, ValueError):
            group["odd"] = draw(st.sampled_from(VALUES))
        with suppress(TypeError, ValueError):
            group["q"].attrs["MATLAB_class"] = draw(st.sampled_from(VALUES))
        cells = group.create_dataset("cell", (2,), h5py.ref_dtype)
        cells[:] = [group["q"].ref, group.ref]
        file["ring"] = file["/"]
    content = (folder / name).read_bytes()
    if name == "run.mat":
        content = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + content[128:]
    (folder / name).write_bytes(draw(spoilt_bytes(content)) if draw(st.booleans()) else content)
    return name, TREE_MAP


def sqlite(draw, folder):
    """Bytes spoilt, another value in all rows of a column or in one, or a table that is gone."""
    path, way = folder / "bag.db3", draw(st.sampled_from(["bytes", "bytes", "cell", "table"]))
    sqlite_bag(path, True)
    if way == "bytes":
        path.write_bytes(draw(spoilt_bytes(path.read_bytes())))
    else:
        bag, table = sqlite3.connect(path), draw(st.sampled_from(sorted(COLUMNS)))
        column = draw(st.sampled_from(COLUMNS[table]))
        whole = st.none() | st.integers(-(2**63), 2**63 - 1) | st.floats()
        odd = draw(whole | st.binary(max_size=40) | st.sampled_from(JUNK))
        where = draw(st.sampled_from(["", " WHERE rowid = 3"])) if column != "id" else " WHERE rowid = 1"
        with suppress(sqlite3.Error):
            drop = f"DROP TABLE {table}"
            bag.execute(drop) if way == "table" else bag.execute(f"UPDATE {table} SET {column} = ?{where}", (odd,))
        bag.commit()
        bag.close()
    return "bag.db3", draw(st.sampled_from([{"time": {"start": 0}, "columns": STATES}, None]))


def lerobot(draw, folder):
    way, mapping = draw(st.sampled_from(["info", "bytes", "column"])), draw(st.sampled_from([None, "mapped"]))
    for part in ("meta", "data"):
        (folder / "set" / part).mkdir(parents=True)
    episode, file = dict(EPISODE), folder / "set" / "data" / "file-000.parquet"
    if way == "column":
        episode[draw(st.sampled_from(sorted(episode)))] = [draw(st.sampled_from(ROWS))] * 6
    parquet.write_table(arrow.table(episode), file)
    if way == "bytes":
        file.write_bytes(draw(spoilt_bytes(file.read_bytes())))
    info = draw(spoilt_page(INFO, json_bytes)) if way == "info" else json_bytes(INFO)
    (folder / "set" / "meta" / "info.json").write_bytes(info)
    numbers = "--episodes", draw(st.sampled_from(["0", "0", "1", "7", "-1"]))
    if mapping:
        return "set", mapped("action[0]", "angle_wrist", "deg", column="timestamp"), *numbers
    return "set", None, *numbers, "--unit", draw(st.sampled_from(["deg", "rad", "", "N", "x"]))


def arrays(draw, folder):
    odd = np.asarray(draw(st.sampled_from([v for v in VALUES if not isinstance(v, list)])))
    name, stream = draw(st.sampled_from(["run.npy", "run.npz"])), io.BytesIO()
    np.save(stream, odd) if name == "run.npy" else np.savez(stream, t=TIME, q=odd)
    content = stream.getvalue()
    (folder / name).write_bytes(draw(spoilt_bytes(content)) if draw(st.booleans()) else content)
    return name, mapped("0" if name == "run.npy" else "q", "force_x", "N")


KINDS = (
    text, own_format, ros_bag, json_tree, json_lines, json_messages, matlab_tree, hdf5, sqlite, lerobot, arrays
)  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
@bounded(4)
@given(data=st.data())
def test_spoilt_recordings(place, data, kind):
    """Imported by a mapping or without one, or listed: none may leave half a file."""
    folder = place()
    name, mapping, *options = kind(data.draw, folder)
    if mapping is not None:
        (folder / "map.yaml").write_text(yaml.safe_dump(mapping))
        options += ["--map", folder / "map.yaml"]
    said = run("import", folder / name, *options, "--out", folder / "out.csv")
    assert ("error: " in said) != (folder / "out.csv").exists(), said
    assert run("import", folder / name)


@bounded(8)
@given(page=spoilt_page(MAPPING), table=st.one_of(st.just(TEXT.encode()), spoilt_table(TEXT)))
def test_spoilt_mappings(place, page, table):
    folder = place()
    (folder / "map.yaml").write_bytes(page)
    (folder / "drive.csv").write_bytes(table)
    said = run("import", folder / "drive.csv", "--map", folder / "map.yaml", "--out", folder / "out.csv")
    assert ("error: " in said) != (folder / "out.csv").exists()


@bounded(5)
@given(data=st.data(), name=st.sampled_from(SETS))
def test_spoilt_recordings_of_machines(place, data, name):
    folder = place()
    (folder / "in").mkdir()
    files = sorted(path for path in made(name, folder / "in").rglob("*") if path.is_file())
    spoilt = data.draw(st.sampled_from(files))
    spoilt.write_bytes(data.draw(spoilt_bytes(spoilt.read_bytes())))
    with suppress(exo.InputError):
        assert READERS[name](folder / "in").logs


@bounded(3)
@given(data=st.data())
def test_spoilt_answers_of_a_diagnosis(data, place):
    """`analyse --diagnosis` draws no robots from what is no answer; a fleet has a row of it, a page and a table."""
    interval = {"value": 1e-3, "low": 9e-4, "high": 1.2e-3, "unit": "m/s"}
    effect = {"id": "motor.dead_zone", "wires": ["AF"], "joints": [], "parameters": {}}
    effect["channels"] = {"width": {"AF": interval}}
    file, whole = place() / "answer.json", json.loads(json.dumps(diagnosis().to_json()))
    file.write_bytes(data.draw(spoilt_page({"verdict": "x", "effects": [effect]}, json_bytes)))
    with suppress(exo.InputError):
        assert all(label for label, _ in within_intervals(exo.load_robot(), read_json(file), 2))
    rows = [read_row(whole, "good")]
    with suppress(json.JSONDecodeError, UnicodeDecodeError):
        spoilt = json.loads(data.draw(spoilt_page(whole, json_bytes)))
        try:
            rows.append(read_row(spoilt, "spoilt"))
        except exo.InputError as error:
            assert str(error).startswith("spoilt") and "\n" not in str(error)
            rows.append(Row("spoilt", "spoilt", reason=str(error)))
        page = fleet_html(sort_rows(rows), "f")
        assert "spoilt" in page and page.encode() and table_bytes(rows).startswith(b"PAR1")
