"""No foreign recording ends in a traceback or in half a file: every reader, on files spoilt in every way we know."""

import io
import json
import sqlite3
from contextlib import suppress

import numpy as np
import pytest
import yaml
from bags import BAG, BAG_MAP, json_mcap, sqlite_bag
from fuzzing import JUNK, bounded, run, spoilt_bytes, spoilt_page, spoilt_table
from hypothesis import given, strategies as st
from scipy.io import savemat
from small_recordings import SETS, made

import exodrake as exo
from exodrake.data.formats import formats

TIME = 0.02 * np.arange(6)
LOG = exo.Log(TIME, {"stroke_AF": np.linspace(0.0, 5e-3, 6), "tension_AF": np.array([1, 2, np.nan, 4, 5, 6])})
TEXT = "time [s],stroke_AF [m],tension_AF [N]\n" + "".join(f"{t},{t / 9},{t * 9}\n" for t in TIME)
MAPPING = {
    "time": {"column": "time [s]", "unit": "s"}, "hold": 1, "separator": ",", "decimal": ".", "skip": 0,
    "columns": {"tension_AF [N]": {"name": "tension_AF", "unit": "N", "scale": 2, "offset": 0}},
}  # fmt: skip
TREE = {"run": {"t": TIME.tolist(), "q": np.outer(TIME, [1.0, 2.0]).tolist(), "note": "left"}, "k": 2.0}
TREE_MAP = {"time": {"column": "run.t"}, "columns": {"run.q[1]": {"name": "angle_elbow", "unit": "rad"}}}
JOINTS = ["wrist.pos", "elbow.pos"]
FEATURE = {"dtype": "float32", "shape": [2], "names": JOINTS}
INFO = {"fps": 50, "features": {"action": FEATURE, "observation.state": FEATURE}}
EPISODE = {"action": [[t, 2 * t] for t in TIME], "observation.state": [[t, t] for t in TIME], "timestamp": list(TIME)}
EPISODE |= {"episode_index": [0, 0, 0, 1, 1, 1]}
VALUES = [
    np.nan, np.inf, None, 10**30, "x", b"\xff", True, 1e308, [], [1.0], [[1.0], [2.0, 3.0]], np.zeros((2, 3, 4)), 3j,
    np.zeros(0), np.array(["a", "b"]), np.float16(1.0), np.arange(6), np.arange(12.0).reshape(6, 2),
    np.array([(1, 2.0)], [("a", "i4"), ("b", "f8")]), np.array(1 + 2j), np.array(["2020-01-01"], "M8[s]"),
]  # fmt: skip


def imported(folder, name, mapping=None, *options) -> None:
    """Imports a recording by its mapping or, without one, lists what it holds; neither may leave half a file."""
    out = folder / "out.csv"
    if mapping is not None:
        (folder / "map.yaml").write_text(yaml.safe_dump(mapping))
        options = (*options, "--map", folder / "map.yaml")
    said = run("import", folder / name, *options, "--out", out)
    assert ("error: " in said) != out.exists(), said
    assert run("import", folder / name)


@bounded(8)
@given(page=spoilt_page(MAPPING), table=st.one_of(st.just(TEXT.encode()), spoilt_table(TEXT)))
def test_spoilt_mappings(place, page, table):
    folder = place()
    (folder / "map.yaml").write_bytes(page)
    (folder / "drive.csv").write_bytes(table)
    said = run("import", folder / "drive.csv", "--map", folder / "map.yaml", "--out", folder / "out.csv")
    assert ("error: " in said) != (folder / "out.csv").exists()


@bounded(4)
@given(table=spoilt_table(TEXT), end=st.sampled_from([".csv", ".txt", ".dat", ".csv.gz", ""]))
def test_spoilt_text(place, table, end):
    folder = place()
    (folder / f"drive{end}").write_bytes(table)
    imported(folder, f"drive{end}", MAPPING)


@bounded(6)
@given(data=st.data(), name=st.sampled_from(["bag.mcap", *(f"d{ending}" for ending in (".npy", *formats()))]))
def test_spoilt_recordings(place, data, name):
    folder = place()
    drive = folder / name
    names = {"stroke_AF": "stroke_AF"} if name == "d.mat" else {"stroke_AF [m]": "stroke_AF"}
    mapping = {"time": {"period": 0.02}, "columns": {k: {"name": v, "unit": "m"} for k, v in names.items()}}
    if name == "bag.mcap":
        drive.write_bytes(BAG)
        mapping = BAG_MAP
    elif name == "d.npy":
        np.save(drive, np.arange(12.0).reshape(4, 3))
        mapping["columns"] = {"1": {"name": "stroke_AF", "unit": "m"}}
    else:
        exo.write_log(LOG, drive)
    drive.write_bytes(data.draw(spoilt_bytes(drive.read_bytes())))
    imported(folder, name, mapping)


@bounded(4)
@given(data=st.data(), end=st.sampled_from([".json", ".jsonl", ".ndjson"]))
def test_spoilt_json(place, data, end):
    folder = place()
    if end == ".json":
        content = data.draw(spoilt_page(TREE, json_bytes))
    else:
        rows = [{"run": {"t": t, "q": [t, 2 * t]}} for t in TIME.tolist()]
        content = b"\n".join(
            data.draw(spoilt_page(row, json_bytes)) if k < 2 else json_bytes(row) for k, row in enumerate(rows)
        )
    (folder / f"run{end}").write_bytes(content)
    imported(folder, f"run{end}", TREE_MAP)


@bounded(4)
@given(
    state=st.sampled_from(VALUES).map(str)
    | st.recursive(
        st.none() | st.floats() | st.integers() | st.text(max_size=4),
        lambda one: (
            st.lists(one, max_size=3) | st.dictionaries(st.sampled_from(["q", "name", "sec", "timestamp"]), one)
        ),
    ),
    field=st.sampled_from(["q", "q[0]", "q[wrist]", "q.name", "timestamp.sec", "[0]", "q]["]),
    stamp=st.sampled_from(["log", "header"]),
)
def test_spoilt_json_messages_of_mcap(place, state, field, stamp):
    folder = place()
    whole = {"q": [1.0, 2.0], "name": ["wrist", "elbow"], "timestamp": {"sec": 1, "nsec": 0}}
    (folder / "a.mcap").write_bytes(json_mcap([("/s", 0.0, whole), ("/s", 0.1, state), ("/s", 0.2, whole)]))
    columns = {f"/s:{field}": {"name": "angle_wrist", "unit": "rad"}}
    imported(folder, "a.mcap", {"columns": columns, "stamp": stamp})


def json_bytes(page) -> bytes:
    """JSON with NaN and numbers of any length, keys as text."""
    return json.dumps(page, skipkeys=True, default=str).encode()


@bounded(4)
@given(data=st.data(), spoilt=st.sampled_from([True, True, False]))
def test_spoilt_trees_of_matlab(place, data, spoilt):
    folder, stream = place(), io.BytesIO()
    tree = {"run": {"t": TIME, "q": np.outer(TIME, [1.0, 2.0]), "odd": data.draw(st.sampled_from(VALUES[4:]))}}
    savemat(stream, tree, do_compression=data.draw(st.booleans()))
    content = stream.getvalue()
    (folder / "run.mat").write_bytes(data.draw(spoilt_bytes(content)) if spoilt else content)
    imported(folder, "run.mat", TREE_MAP)


@bounded(5)
@given(
    data=st.data(), name=st.sampled_from(["run.h5", "run.hdf5", "run.mat"]), spoilt=st.sampled_from([True, True, False])
)
def test_spoilt_hdf5(place, data, name, spoilt):
    folder, matlab = place(), name == "run.mat"
    content = hdf5_bytes(
        folder / "made", matlab, data.draw(st.sampled_from(VALUES)), data.draw(st.sampled_from(VALUES))
    )
    (folder / name).write_bytes(data.draw(spoilt_bytes(content)) if spoilt else content)
    imported(folder, name, TREE_MAP)


def hdf5_bytes(path, matlab: bool, odd, attribute) -> bytes:
    """A group with time, angles and something odd, as MATLAB 7.3 writes it or as h5py does."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512 if matlab else 0) as file:
        group = file.create_group("run")
        group["t"], group["q"] = TIME[None] if matlab else TIME, np.outer([1.0, 2.0], TIME)
        with suppress(TypeError, ValueError):
            group["odd"] = odd
        with suppress(TypeError, ValueError):
            group["q"].attrs["MATLAB_class"] = attribute
        cells = group.create_dataset("cell", (2,), h5py.ref_dtype)
        cells[:] = [group["q"].ref, group.ref]
        file["ring"] = file["/"]
    content = path.read_bytes()
    path.unlink()
    return b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + content[128:] if matlab else content


STATES = {f"/joint_states:position[{j}]": {"name": f"angle_{j}", "unit": "rad"} for j in ("wrist", "elbow")}


@pytest.fixture(scope="module")
def bag_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("bag") / "bag.db3"
    sqlite_bag(path, True)
    return path.read_bytes()


@bounded(4)
@given(data=st.data(), way=st.sampled_from(["bytes", "bytes", "cell", "table"]))
def test_spoilt_bags_in_sqlite(place, bag_file, data, way):
    folder = place()
    path = folder / "bag.db3"
    path.write_bytes(data.draw(spoilt_bytes(bag_file)) if way == "bytes" else bag_file)
    if way != "bytes":
        with sqlite3.connect(path) as bag:
            spoil_table(bag, data, way)
        bag.close()
    imported(folder, "bag.db3", {"time": {"start": 0}, "columns": STATES})
    (folder / "out.csv").unlink(missing_ok=True)
    imported(folder, "bag.db3")


COLUMNS = {
    "topics": ["id", "name", "type"], "messages": ["topic_id", "timestamp", "data"],
    "message_definitions": ["topic_type", "encoded_message_definition"],
}  # fmt: skip


def spoil_table(bag, data, way: str) -> None:
    """Another value in all rows of a column or in one, or a table that is gone."""
    table = data.draw(st.sampled_from(sorted(COLUMNS)))
    if way == "table":
        bag.execute(f"DROP TABLE {table}")
        return
    column = data.draw(st.sampled_from(COLUMNS[table]))
    odd = st.one_of(
        st.none(), st.integers(-(2**63), 2**63 - 1), st.floats(), st.binary(max_size=40), st.sampled_from(JUNK)
    )
    where = data.draw(st.sampled_from(["", " WHERE rowid = 3"])) if column != "id" else " WHERE rowid = 1"
    with suppress(sqlite3.Error):
        bag.execute(f"UPDATE {table} SET {column} = ?{where}", (data.draw(odd),))


@bounded(4)
@given(data=st.data(), way=st.sampled_from(["info", "bytes", "column"]), mapped=st.booleans())
def test_spoilt_lerobot_data_sets(place, data, way, mapped):
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    folder = place()
    for part in ("meta", "data"):
        (folder / "set" / part).mkdir(parents=True)
    episode = dict(EPISODE)
    if way == "column":
        episode[data.draw(st.sampled_from(sorted(episode)))] = [data.draw(st.sampled_from(ROWS))] * 6
    file = folder / "set" / "data" / "file-000.parquet"
    parquet.write_table(arrow.table(episode), file)
    if way == "bytes":
        file.write_bytes(data.draw(spoilt_bytes(file.read_bytes())))
    info = data.draw(spoilt_page(INFO, json_bytes)) if way == "info" else json_bytes(INFO)
    (folder / "set" / "meta" / "info.json").write_bytes(info)
    columns = {"action[0]": {"name": "angle_wrist", "unit": "deg"}}
    mapping = {"time": {"column": "timestamp"}, "columns": columns} if mapped else None
    unit = () if mapped else ("--unit", data.draw(st.sampled_from(["deg", "rad", "", "N", "x"])))
    imported(folder, "set", mapping, "--episodes", data.draw(st.sampled_from(["0", "0", "1", "7", "-1"])), *unit)


ROWS = [None, float("nan"), float("inf"), 1e300, "x", True, [1.0], [1.0, None], [[1.0]], [], {"a": 1}, b"x", -1]


@bounded(3)
@given(data=st.data(), end=st.sampled_from([".npy", ".npz"]), spoilt=st.booleans())
def test_spoilt_arrays(place, data, end, spoilt):
    folder, stream = place(), io.BytesIO()
    odd = np.asarray(data.draw(st.sampled_from([v for v in VALUES if not isinstance(v, list)])))
    if end == ".npy":
        np.save(stream, odd)
    else:
        np.savez(stream, t=TIME, q=odd)
    (folder / f"run{end}").write_bytes(data.draw(spoilt_bytes(stream.getvalue())) if spoilt else stream.getvalue())
    name = "0" if end == ".npy" else "q"
    imported(folder, f"run{end}", {"time": {"period": 0.02}, "columns": {name: {"name": "force_x", "unit": "N"}}})


@bounded(5)
@given(data=st.data(), name=st.sampled_from(SETS))
def test_spoilt_recordings_of_machines(place, data, name):
    folder = place()
    (folder / "in").mkdir()
    files = sorted(path for path in made(name, folder / "in").rglob("*") if path.is_file())
    spoilt = data.draw(st.sampled_from(files))
    spoilt.write_bytes(data.draw(spoilt_bytes(spoilt.read_bytes())))
    said = run("import", folder / "in", "--from", name, "--out", folder / "out")
    assert ("error: " in said) != (folder / "out" / "case.yaml").exists()


@bounded(3)
@given(data=st.data())
def test_spoilt_answers_of_a_diagnosis(data, place):
    """`analyse --diagnosis` draws no robots from what is no answer."""
    from exodrake.analysis.robustness import read_diagnosis, within_intervals

    interval = {"value": 1e-3, "low": 9e-4, "high": 1.2e-3, "unit": "m/s"}
    effect = {
        "id": "motor.dead_zone",
        "wires": ["AF"],
        "joints": [],
        "parameters": {},
        "channels": {"width": {"AF": interval}},
    }
    file = place() / "answer.json"
    file.write_bytes(data.draw(spoilt_page({"verdict": "x", "effects": [effect]}, json_bytes)))
    with suppress(exo.InputError):
        assert all(label for label, _ in within_intervals(exo.load_robot(), read_diagnosis(file)[0], 2))
