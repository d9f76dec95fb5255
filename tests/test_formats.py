"""Foreign recordings: what a mapping file says is what the log holds; what it cannot say is refused by name."""

import io
import json

import numpy as np
import pytest
import yaml
from bags import BAG, BAG_MAP
from mcap.reader import make_reader
from scipy.io import loadmat, savemat

from exodrake.core.errors import InputError
from exodrake.data.formats import write_log
from exodrake.data.import_log import import_log
from exodrake.data.log import Log

TABLE = 't,cell,pos,note\n0,1000,"[1.0, 90.0]",start\n20000,,"[2.0, 180.0]",go\n40000,3000,"[3.0, 270.0]",stop\n'
MAP = {
    "time": {"column": "t", "unit": "us"},
    "columns": {
        "cell": {"name": "tension_AF", "unit": "mN", "scale": 0.5, "offset": -100},
        "pos[1]": {"name": "position_elbow", "unit": "deg"},
    },
}


def imported(folder, mapping=MAP, content=TABLE, name="drive.csv") -> Log:
    """Import through files, as the command does."""
    (folder / "map.yaml").write_text(mapping if isinstance(mapping, str) else yaml.safe_dump(mapping))
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return import_log(folder / name, folder / "map.yaml")


def changed(**keys) -> dict:
    return {**MAP, **keys}


def test_text_by_mapping(tmp_path):
    log = imported(tmp_path)
    np.testing.assert_array_equal(log.time, [0, 0.02, 0.04])
    np.testing.assert_allclose(log["tension_AF"], [0.4, np.nan, 1.4], rtol=1e-15)
    np.testing.assert_allclose(log["position_elbow"], [np.pi / 2, np.pi, 1.5 * np.pi])
    assert log.units == {"tension_AF": "N", "position_elbow": "rad"}


def test_text_of_other_habits(tmp_path):
    mapping = {
        "time": {"period": 0.01},
        "columns": {"1": {"name": "force_x", "unit": "kN"}},
        **{"separator": ";", "decimal": ",", "skip": 2, "heading": False},
    }
    log = imported(tmp_path, mapping, "# made by\n# someone\n7;1,5\n8;2,5\n")
    np.testing.assert_allclose(log["force_x"], [1500, 2500])
    np.testing.assert_allclose(log.time, [0, 0.01])


def test_repeated_times_and_frames(tmp_path):
    mapping = {"time": {"column": "t", "start": 5}, "period": 0.02, "columns": {"x": {"name": "force_x", "unit": "N"}}}
    rows = [(0, 1), (0, 1), (0.01, 2), (0.021, 3), (0.1, 4)]
    log = imported(tmp_path, mapping, "t,x\n" + "\n".join(f"{t},{x}" for t, x in rows))
    np.testing.assert_allclose(log.time, 5 + 0.02 * np.arange(6))
    np.testing.assert_array_equal(log["force_x"], [2, 3, 3, np.nan, np.nan, 4])


def test_matlab_and_numpy(tmp_path):
    stream = io.BytesIO()
    savemat(stream, {"t": np.arange(3.0) * 2e4, "cell": [1.0, 2, 3], "pos": np.arange(6.0).reshape(3, 2), "who": "me"})
    log = imported(tmp_path, content=stream.getvalue(), name="d.mat")
    np.testing.assert_allclose(log["position_elbow"], np.radians([1, 3, 5]))
    stream = io.BytesIO()
    np.save(stream, np.arange(6.0).reshape(3, 2))
    mapping = {"time": {"column": "0"}, "columns": {"1": {"name": "angle_MCP", "unit": "rad"}}}
    np.testing.assert_array_equal(imported(tmp_path, mapping, stream.getvalue(), "d.npy")["angle_MCP"], [1, 3, 5])


@pytest.mark.parametrize(
    ("mapping", "content", "parts"),
    [
        (MAP, "", ["drive.csv", "empty"]),
        (MAP, TABLE.replace("cell", "zelle"), ["drive.csv", "'cell'", "zelle"]),
        (MAP, TABLE.replace("3000", "much"), ["'cell'", "row 3", "'much'"]),
        (MAP, TABLE.replace(", 270.0", ""), ["'pos[1]'", "row 3"]),
        (MAP, TABLE.replace("40000", "10000"), ["'t'", "row 3"]),
        (MAP, TABLE.replace("20000", ""), ["'t'", "row 2"]),
        (MAP, TABLE.replace(",stop", ""), ["row 3", "3 cells"]),
        (MAP, TABLE.replace("note", "cell"), ["'cell'", "twice"]),
        (MAP, TABLE.replace("1000", "").replace("3000", ""), ["tension_AF", "empty"]),
        (changed(time={}), TABLE, ["no time"]),
        (changed(time={"column": "t", "unit": "fortnight"}), TABLE, ["map.yaml", "'time'", "fortnight"]),
        (changed(columns={}), TABLE, ["map.yaml", "'columns'"]),
        (changed(columns={"cell": {"name": "tension_AF"}}), TABLE, ["'columns.cell'", "'unit'"]),
        (changed(columns={"cell": {"name": "tension_AF", "unit": "mm"}}), TABLE, ["'columns.cell'", "[mm]", "[N]"]),
        (changed(columns={"cell": {"name": "time", "unit": "s"}}), TABLE, ["'time'"]),
        (
            changed(columns={"cell": {"name": "x", "unit": "N", "scale": "big"}}),
            TABLE,
            ["'columns.cell.scale'", "'big'"],
        ),
        (changed(sepparator=";"), TABLE, ["'sepparator'", "'separator'"]),
        (changed(period=0), TABLE, ["'period'"]),
        (changed(period=1e-9), TABLE.replace("40000", "4e13"), ["too many"]),
        ("- 1", TABLE, ["map.yaml"]),
    ],
)
def test_what_is_wrong_is_named(tmp_path, mapping, content, parts):
    with pytest.raises(InputError) as caught:
        imported(tmp_path, mapping, content)
    for part in parts:
        assert part in str(caught.value)


def test_mcap_is_what_foxglove_opens(tmp_path):
    log = Log(np.array([-0.02, 0, 0.02]), {"tension_AF": np.array([1, np.nan, 3]), "angle_MCP": np.ones(3)})
    write_log(log, tmp_path / "log.mcap")
    with open(tmp_path / "log.mcap", "rb") as stream:
        found = [(s, c, m) for s, c, m in make_reader(stream).iter_messages(topics=["/tension"])]
    assert [json.loads(message.data) for *_, message in found] == [{"AF": 1.0}, {}, {"AF": 3.0}]
    assert [message.log_time for *_, message in found] == [0, 20_000_000, 40_000_000]
    assert found[0][0].encoding == "jsonschema" and found[0][1].message_encoding == "json"
    assert json.loads(found[0][0].data)["properties"]["AF"] == {"type": "number", "description": "N"}


def test_mat_is_what_matlab_opens(tmp_path):
    write_log(Log(np.arange(3.0), {"tension_AF": np.arange(3.0)}), tmp_path / "log.mat")
    found = loadmat(tmp_path / "log.mat")
    assert found["tension_AF"].shape == (3, 1) and found["units"]["tension_AF"][0, 0].item() == "N"
    with pytest.raises(InputError, match="odd-name"):
        write_log(Log(np.arange(3.0), {"odd-name": np.arange(3.0)}, {"odd-name": "N"}), tmp_path / "odd.mat")
    assert not (tmp_path / "odd.mat").exists()


@pytest.mark.parametrize("stamp", ["log", "header"])
def test_ros2_bag(tmp_path, stamp):
    mapping = {**BAG_MAP, "period": 0.02, "stamp": stamp}
    if stamp == "header":
        mapping["columns"] = {key: value for key, value in BAG_MAP["columns"].items() if "command" not in key}
    log = imported(tmp_path, mapping, BAG, "bag.mcap")
    assert len(log) == 100 and log.dt == pytest.approx(0.02)
    np.testing.assert_array_equal(log["angle_MCP"], 2.0 * np.arange(100))
    np.testing.assert_array_equal(log["angle_PIP"], 1.0 * np.arange(100))
    np.testing.assert_array_equal(log["force_z"][:50], 1.0 + 2 * np.arange(50))
    assert np.isnan(log["force_z"][52:]).all()
    if stamp == "log":
        assert np.isfinite(log["speed_cmd_AF"][[0, 20, 40]]).all() and np.isnan(log["speed_cmd_AF"][10])


def test_ros2_hold_keeps_a_command(tmp_path):
    log = imported(tmp_path, {**BAG_MAP, "hold": 1000}, BAG, "bag.mcap")
    np.testing.assert_allclose(log["speed_cmd_AF"], 0.04 * (np.arange(100) // 20))


@pytest.mark.parametrize(
    ("column", "part"),
    [
        ("/joint_states", "TOPIC:FIELD"),
        ("/nothing:data", "'/nothing'"),
        ("/command:daten", "'daten'"),
        ("/joint_states:name", "not a number"),
        ("/joint_states:velocity[9]", "empty"),
    ],
)
def test_ros2_wrong_column_is_named(tmp_path, column, part):
    mapping = {"columns": {column: {"name": "force_x", "unit": "N"}}}
    with pytest.raises(InputError, match=part.replace("[", r"\[")):
        imported(tmp_path, mapping, BAG, "bag.mcap")
