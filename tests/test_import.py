"""Foreign recordings of every kind: what a mapping file says is what the log holds; what it cannot say is refused."""

import io
import json
import re
from dataclasses import replace

import h5py
import numpy as np
import pytest
import yaml
from bags import BAG, BAG_MAP, TIME, N, Q, example_mcap, imported, json_mcap, lerobot, sqlite_bag
from command_line import run
from mcap.reader import make_reader
from mcap_ros2.writer import Writer as RosWriter
from scipy.io import loadmat, savemat

from exodrake.core.errors import InputError
from exodrake.data.case import read_case
from exodrake.data.formats import read_log, write_log
from exodrake.data.import_log import (
    Column,
    Mapped,
    Track,
    convert_table,
    find_lag,
    import_all,
    import_recording,
    low_pass,
    read_mapping,
)
from exodrake.data.log import Log
from exodrake.data.tables import list_columns

MAP = {
    "time": {"column": "run.t", "unit": "s"},
    "columns": {"run.q[1]": {"name": "angle_elbow", "unit": "rad"}, "run.q[0]": {"name": "angle_wrist", "unit": "rad"}},
}


TABLE = 't,cell,pos,note\n0,1000,"[1.0, 90.0]",start\n20000,,"[2.0, 180.0]",go\n40000,3000,"[3.0, 270.0]",stop\n'
TABLE_MAP = {
    "time": {"column": "t", "unit": "us"},
    "columns": {
        "cell": {"name": "tension_AF", "unit": "mN", "scale": 0.5, "offset": -100},
        "pos[1]": {"name": "position_elbow", "unit": "deg"},
    },
}
NAMES = ("angle_wrist", "angle_elbow")


def changed(**keys) -> dict:
    return {**TABLE_MAP, **keys}


def check(log) -> None:
    """The log holds both angles."""
    np.testing.assert_allclose(log.time, TIME, atol=1e-12)
    np.testing.assert_array_equal(log.array("angle", ("wrist", "elbow")), Q)


def test_text_by_mapping(tmp_path):
    log = imported(tmp_path, TABLE, TABLE_MAP)
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
    log = imported(tmp_path, "# made by\n# someone\n7;1,5\n8;2,5\n", mapping)
    np.testing.assert_allclose(log["force_x"], [1500, 2500])
    np.testing.assert_allclose(log.time, [0, 0.01])


def test_repeated_times_and_frames(tmp_path):
    mapping = {"time": {"column": "t", "start": 5}, "period": 0.02, "columns": {"x": {"name": "force_x", "unit": "N"}}}
    rows = [(0, 1), (0, 1), (0.01, 2), (0.021, 3), (0.1, 4)]
    log = imported(tmp_path, "t,x\n" + "\n".join(f"{t},{x}" for t, x in rows), mapping)
    np.testing.assert_allclose(log.time, 5 + 0.02 * np.arange(6))
    np.testing.assert_array_equal(log["force_x"], [2, 3, 3, np.nan, np.nan, 4])


@pytest.mark.parametrize(
    ("mapping", "content", "parts"),
    [
        (TABLE_MAP, "", ["drive.csv", "empty"]),
        (TABLE_MAP, TABLE.replace("cell", "zelle"), ["drive.csv", "'cell'", "zelle"]),
        (TABLE_MAP, TABLE.replace("3000", "much"), ["'cell'", "row 3", "'much'"]),
        (TABLE_MAP, TABLE.replace(", 270.0", ""), ["'pos[1]'", "row 3"]),
        (TABLE_MAP, TABLE.replace("40000", "10000"), ["'t'", "row 3"]),
        (TABLE_MAP, TABLE.replace("20000", ""), ["'t'", "row 2"]),
        (TABLE_MAP, TABLE.replace(",stop", ""), ["row 3", "3 cells"]),
        (TABLE_MAP, TABLE.replace("note", "cell"), ["'cell'", "twice"]),
        (TABLE_MAP, TABLE.replace("1000", "").replace("3000", ""), ["tension_AF", "empty"]),
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
        (changed(sepparator=";"), TABLE, ["'sepparator'", "did you mean separator?"]),
        (changed(period=0), TABLE, ["'period'"]),
        (changed(period=1e-9), TABLE.replace("40000", "4e13"), ["too many"]),
        ("- 1", TABLE, ["map.yaml"]),
    ],
)
def test_what_is_wrong_is_named(tmp_path, mapping, content, parts):
    with pytest.raises(InputError) as caught:
        imported(tmp_path, content, mapping)
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
    log = imported(tmp_path, BAG, mapping, "bag.mcap")
    assert len(log) == 100 and log.dt == pytest.approx(0.02)
    np.testing.assert_array_equal(log["angle_MCP"], 2.0 * np.arange(100))
    np.testing.assert_array_equal(log["angle_PIP"], 1.0 * np.arange(100))
    np.testing.assert_array_equal(log["force_z"][:50], 1.0 + 2 * np.arange(50))
    assert np.isnan(log["force_z"][52:]).all()
    if stamp == "log":
        assert np.isfinite(log["speed_cmd_AF"][[0, 20, 40]]).all() and np.isnan(log["speed_cmd_AF"][10])


def test_ros2_hold_keeps_a_command(tmp_path):
    log = imported(tmp_path, BAG, {**BAG_MAP, "hold": 1000}, "bag.mcap")
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
        imported(tmp_path, BAG, mapping, "bag.mcap")


@pytest.mark.parametrize("turned", [False, True])
def test_a_matlab_struct_either_way_round(tmp_path, turned):
    stream = io.BytesIO()
    savemat(stream, {"run": {"t": TIME, "q": Q.T if turned else Q, "note": "left arm", "cal": {"k": 2.0}}})
    check(imported(tmp_path, stream.getvalue(), MAP, "run.mat"))


def test_arrays_of_structs_and_cells_have_an_index(tmp_path):
    stream = io.BytesIO()
    cell = np.empty(2, dtype=object)
    cell[:] = [np.zeros(3), Q]
    savemat(stream, {"trial": [{"t": TIME}, {"t": 1.0 + TIME}], "c": cell})
    mapping = {"time": {"column": "trial[1].t"}, "columns": {"c[1][0]": {"name": "angle_wrist", "unit": "rad"}}}
    log = imported(tmp_path, stream.getvalue(), mapping, "run.mat")
    np.testing.assert_array_equal(log.time, 1.0 + TIME)
    np.testing.assert_array_equal(log["angle_wrist"], Q[:, 0])


def test_a_square_matrix_is_read_as_the_mapping_says(tmp_path):
    stream, square = io.BytesIO(), np.arange(9.0).reshape(3, 3)
    np.save(stream, square)
    for side, wanted in (("rows", square[:, 1]), ("columns", square[1])):
        mapping = {"time": {"period": 0.02}, "columns": {"1": {"name": "force_x", "unit": "N"}}, "samples": side}
        np.testing.assert_array_equal(imported(tmp_path, stream.getvalue(), mapping, "q.npy")["force_x"], wanted)


@pytest.mark.parametrize("matlab", [False, True])
def test_hdf5_and_matlab_7_3(tmp_path, matlab):
    with h5py.File(tmp_path / "made.h5", "w", userblock_size=512 if matlab else 0) as file:
        group = file.create_group("run")
        data = {"t": TIME[None] if matlab else TIME, "q": Q.T if matlab else Q}
        for name, values in data.items():
            group[name] = values
            if matlab:
                group[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["elsewhere"] = h5py.ExternalLink("/etc/passwd", "/")
        file["round"] = file["/"]
    content = (tmp_path / "made.h5").read_bytes()
    if matlab:  # as MATLAB heads its files of version 7.3
        content = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + content[128:]
    check(imported(tmp_path, content, MAP, "run.mat" if matlab else "run.h5"))
    slashes = {**MAP, "time": {"column": "/run/t"}}
    check(imported(tmp_path, content, slashes, "run.mat" if matlab else "run.h5"))


def test_json_objects_records_and_lines(tmp_path):
    whole = {"run": {"t": TIME.tolist(), "q": Q.tolist(), "who": "me"}}
    check(imported(tmp_path, json.dumps(whole), MAP, "run.json"))
    rows = [{"t": t, "q": q, "ok": True} for t, q in zip(TIME.tolist(), Q.tolist(), strict=True)]
    check(imported(tmp_path, json.dumps({"run": rows}), MAP, "run.json"))
    lines = "\n".join(json.dumps({"run": row}) for row in rows).encode()
    check(imported(tmp_path, lines, MAP, "run.jsonl"))
    for spoilt, word in ((b"[" * 100_000, "deep"), (b"{", "not JSON"), (b"3", "one value")):
        with pytest.raises(InputError, match=word):
            imported(tmp_path, spoilt, MAP, "run.json")


@pytest.mark.parametrize("definitions", [False, True])
def test_a_bag_in_sqlite(tmp_path, definitions):
    columns = {f"/joint_states:position[{j}]": {"name": f"angle_{j}", "unit": "rad"} for j in ("wrist", "elbow")}
    (tmp_path / "bag").mkdir()
    sqlite_bag(tmp_path / "bag" / "bag_0.db3", definitions)
    content = (tmp_path / "bag" / "bag_0.db3").read_bytes()
    check(imported(tmp_path, content, {"time": {"start": 0}, "columns": columns}, "run.db3"))
    check(import_recording(tmp_path / "bag", read_mapping(tmp_path / "map.yaml")).log)


def test_joint_states_need_no_mapping(tmp_path):
    sqlite_bag(tmp_path / "run.db3", False)
    (tmp_path / "hand.mcap").write_bytes(BAG)
    log = import_all(tmp_path / "run.db3", None)["run"].log
    check(log)
    np.testing.assert_array_equal(log["angle_ref_wrist"][::2], Q[::2, 0])
    np.testing.assert_array_equal(log["angle_start_elbow"], 1.0)
    hand = import_all(tmp_path / "hand.mcap", None)["hand"].log
    np.testing.assert_array_equal(hand["angle_MCP"], 2.0 * np.arange(100))
    listed = run("import", tmp_path / "hand.mcap")
    assert "/joint_states" in listed.output and "position[MCP]" in listed.output and "wrench.force.z" in listed.output


def test_a_log_of_ours_in_mcap_is_listed_and_imported_by_its_headings(tmp_path):
    log = Log(TIME, {"angle_wrist": Q[:, 0], "tension_AF": np.where(TIME < 0.1, np.nan, 3.0)})
    write_log(log, tmp_path / "log.mcap")
    listed = run("import", tmp_path / "log.mcap")
    assert listed.exit_code == 0 and "angle_wrist [rad]" in listed.output and "tension_AF [N]" in listed.output
    made = run("import", tmp_path / "log.mcap", "--out", tmp_path / "log.csv")
    assert made.exit_code == 0 and read_log(tmp_path / "log.csv").equals(log)
    columns = {"tension_AF [N]": {"name": "force_x", "unit": "N"}}
    mapping = {"time": {"column": "time [s]"}, "columns": columns}
    mapped = imported(tmp_path, (tmp_path / "log.mcap").read_bytes(), mapping, "log.mcap")
    np.testing.assert_array_equal(mapped["force_x"], log["tension_AF"])


def test_topics_that_cannot_be_decoded_are_listed_as_such(tmp_path):
    poses = [("/pose", time, {"x": 1.0}) for time in TIME]
    (tmp_path / "run.mcap").write_bytes(json_mcap(poses, encoding="protobuf"))
    words = run("import", tmp_path / "run.mcap").output.split()
    assert words[words.index("/pose") :][:6] == ["/pose", "pose", str(N), "cannot", "be", "decoded:"]


@pytest.mark.parametrize(
    ("content", "fields"),
    [
        (lambda q: {"joint": {"q": q}}, ("joint.q[0]", "joint.q[1]")),
        (lambda q: {"name": ["wrist", "elbow"], "position": q}, ("position[wrist]", "position[elbow]")),
        (
            lambda q: {"joints": [{"name": n, "position": v} for n, v in zip(("wrist", "elbow"), q)]},
            ("joints[wrist].position", "joints[elbow].position"),
        ),
        (lambda q: {"wrist.pos": q[0], "elbow.pos": q[1]}, ("wrist.pos", "elbow.pos")),
    ],
    ids=["arrays", "names beside", "records with names", "keys with dots"],
)
def test_json_messages_of_mcap(tmp_path, content, fields):
    """Arms are recorded in MCAP as JSON by a list, by joint states, by records of joints, or by LeRobot's keys."""
    messages = [(topic, time, content(q.tolist())) for time, q in zip(TIME, Q) for topic in ("/state", "/command")]
    (tmp_path / "run.mcap").write_bytes(json_mcap(messages))
    listed = "".join(run("import", tmp_path / "run.mcap").output.split())
    assert all(field in listed for field in fields)
    columns = {f"/state:{field}": {"name": name, "unit": "rad"} for field, name in zip(fields, NAMES)}
    columns |= {f"/command:{fields[0]}": {"name": "angle_ref_wrist", "unit": "deg"}}
    mapping = {"time": {"start": 0}, "columns": columns, "period": 0.02}
    log = imported(tmp_path, (tmp_path / "run.mcap").read_bytes(), mapping, "run.mcap")
    check(log)
    np.testing.assert_allclose(log["angle_ref_wrist"], np.radians(Q[:, 0]))


def test_episodes_of_examples_in_protobuf_are_read_as_they_are(tmp_path):
    """Protobuf examples of a step each, with images beside the joints; the publisher's clock is that of the step."""
    pytest.importorskip("mcap_protobuf", reason="of the extra mcap")
    steps = []
    for time, q in zip(TIME, Q):
        seen = {"observation/joints_pos": ("float_list", q), "observation/camera": ("bytes_list", [b"jpeg"])}
        steps.append((time, "/timestep", seen | {"step_type": ("int64_list", [1])}))
        steps.append((time, "/action", {"action": ("float_list", q[::-1])}))
    example_mcap(tmp_path / "episode.mcap", steps)
    listed = "".join(run("import", tmp_path / "episode.mcap").output.split())
    assert all(field in listed for field in ("observation/joints_pos[0]", "observation/joints_pos[1]", "action[1]"))
    assert "camera" not in listed
    columns = {f"/timestep:observation/joints_pos[{k}]": {"name": name, "unit": "rad"} for k, name in enumerate(NAMES)}
    columns |= {"/action:action[1]": {"name": "angle_ref_wrist", "unit": "rad"}}
    mapping = {"time": {"start": 0}, "columns": columns, "stamp": "publish", "period": 0.02}
    log = imported(tmp_path, (tmp_path / "episode.mcap").read_bytes(), mapping, "episode.mcap")
    np.testing.assert_allclose(log["angle_ref_wrist"], log["angle_wrist"])
    np.testing.assert_allclose(log["angle_elbow"], Q[:, 1], atol=1e-7)


def test_json_messages_have_foxgloves_stamp_and_are_refused_by_topic(tmp_path):
    stamp = [{"timestamp": {"sec": 7, "nsec": round(1e9 * t)}, "q": q[0]} for t, q in zip(TIME[:40], Q)]
    content = json_mcap([("/state", 5.0 + 0.1 * k, state) for k, state in enumerate(stamp)])
    mapping = {"columns": {"/state:q": {"name": "angle_wrist", "unit": "rad"}}, "stamp": "header", "period": 0.02}
    log = imported(tmp_path, content, mapping, "run.mcap")
    np.testing.assert_allclose(log.time[[0, -1]], [7.0, 7.0 + TIME[-1]])
    for key, said in (("/state:speed", "topic '/state' has no field 'speed'"), ("/state:timestamp", "is not a number")):
        wrong = {**mapping, "columns": {key: {"name": "angle_wrist", "unit": "rad"}}}
        with pytest.raises(InputError, match=re.escape(said)):
            imported(tmp_path, content, wrong, "run.mcap")


def test_messages_in_a_list_of_a_message_are_listed_and_read(tmp_path):
    stream = io.BytesIO()
    writer = RosWriter(stream)
    text = f"my_msgs/Motor[] motors\n{'=' * 80}\nMSG: my_msgs/Motor\nfloat64 turns\nstring label\n"
    kind = writer.register_msgdef("my_msgs/msg/Motors", text)
    for n, time in enumerate(TIME):
        stamp = round(1e9 * time)
        motors = [{"turns": Q[n, k], "label": "m"} for k in range(2)]
        writer.write_message("/motors", kind, {"motors": motors}, log_time=stamp, publish_time=stamp)
    writer.finish()
    columns = {f"/motors:motors[{k}].turns": {"name": name, "unit": "rad"} for k, name in enumerate(NAMES)}
    mapping = {"time": {"start": 0}, "columns": columns, "period": 0.02}
    log = imported(tmp_path, stream.getvalue(), mapping, "run.mcap")
    check(log)
    listed = run("import", tmp_path / "run.mcap").output
    assert "motors[0].turns" in listed and "motors[1].turns" in listed and "label" not in listed


@pytest.mark.parametrize("version", [2, 3])
def test_a_lerobot_data_set(tmp_path, version):
    one_file = {"chunk-000/file-000.parquet": range(3)}
    files = one_file if version == 3 else {f"chunk-000/episode_{k:06d}.parquet": [k] for k in range(3)}
    lerobot(tmp_path / "set", files, grouped=version == 2)
    made = run("import", tmp_path / "set", "--unit", "deg", "--out", tmp_path / "case")
    assert made.exit_code == 0, made.output
    case = read_case(tmp_path / "case")
    assert [item.role for item in case.logs] == ["fit", "fit", "holdout"] and case.period == 0.02
    last = case.logs[2].log
    np.testing.assert_allclose(np.degrees(last["angle_wristFlex"]), 10.0 * Q[:, 0] + 2.0, atol=1e-12)
    np.testing.assert_allclose(np.degrees(last["angle_ref_elbowFlex"]), 10.0 * Q[:, 1], atol=1e-12)
    one = run("import", tmp_path / "set", "--unit", "deg", "--episodes", "1", "--out", tmp_path / "one.csv")
    assert one.exit_code == 0 and len(read_log(tmp_path / "one.csv")) == N
    assert "--unit deg" in run("import", tmp_path / "set", "--out", tmp_path / "none").stderr
    lerobot(tmp_path / "nan", {"a.parquet": [0.0, float("nan")]})
    assert "'episode_index': wanted one number" in run("import", tmp_path / "nan").stderr


def test_a_counter_that_starts_again_is_made_continuous_with_its_sign(tmp_path):
    turns = np.linspace(0.0, 3.0, N)
    text = "t,count\n" + "\n".join(f"{t},{c}" for t, c in zip(TIME, np.floor(4096 * turns) % 4096))
    column = {"name": "angle_wheel", "unit": "rev", "scale": 1 / 4096, "sign": -1, "wrap": 4096}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({"time": {"column": "t"}, "columns": {"count": column}}))
    (tmp_path / "c.csv").write_text(text)
    found = import_recording(tmp_path / "c.csv", read_mapping(tmp_path / "map.yaml"))
    np.testing.assert_allclose(found.log["angle_wheel"], -2 * np.pi * turns, atol=2 * np.pi / 4096)
    assert found.notes == ("angle_wheel: made continuous where readings start again after 4096, sign turned",)
    column["wrap"] = 360.0
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({"time": {"column": "t"}, "columns": {"count": column}}))
    with pytest.raises(InputError, match=r"angle_wheel spans \d+ .*, more than wrap: 360"):
        import_recording(tmp_path / "c.csv", read_mapping(tmp_path / "map.yaml"))


def test_a_zero_phase_filter_halves_the_amplitude_at_its_cut_off_and_delays_nothing():
    time, cutoff = 0.001 * np.arange(8000), 10.0
    middle = slice(2000, 6000)
    for frequency, gain in ((1.0, 1.0), (cutoff, 0.5), (100.0, 0.0)):
        wave = np.sin(2 * np.pi * frequency * time)
        passed = low_pass(time, wave, cutoff, "x")
        np.testing.assert_allclose(passed[middle], gain * wave[middle], atol=1e-3)
    holed = np.where(np.arange(8000) % 100 == 7, np.nan, np.sin(2 * np.pi * time))
    np.testing.assert_array_equal(np.isnan(low_pass(time, holed, cutoff, "x")), np.isnan(holed))
    for bad, word in ((600.0, "half the sampling rate"), (10.0, "even clock")):
        uneven = time if bad == 600.0 else time + 0.0004 * (np.arange(8000) % 2)
        with pytest.raises(InputError, match=word):
            low_pass(uneven, time, bad, "x")


@pytest.mark.parametrize(("frequency", "cutoff"), [(0.3, 10.0), (1.0, 10.0), (0.3, 5.0)])
def test_a_filtered_acceleration_is_right_at_the_ends_of_a_log_that_begins_and_ends_in_motion(frequency, cutoff):
    time, w = 0.005 * np.arange(1237), 2.0 * np.pi * frequency
    rates = low_pass(time, np.sin(w * time + 0.4), cutoff, "x")
    for _ in range(2):
        rates = np.gradient(rates, time, edge_order=2)
    wrong = np.abs(rates + w**2 * np.sin(w * time + 0.4)) / w**2
    assert wrong[2:-2].max() < 0.05 and wrong[20:-20].max() < 0.02


@pytest.mark.parametrize(("frequency", "cutoff"), [(0.3, 10.0), (1.0, 10.0), (0.3, 5.0)])
def test_an_imported_acceleration_is_right_wherever_its_log_is_kept(frequency, cutoff):
    time, w = 0.005 * np.arange(1237), 2.0 * np.pi * frequency
    rates = (Column("position_J", "velocity_J", take="rate"), Column("velocity_J", "twice", take="rate"))
    first = Column("position_J", "position_start_J", take="first")
    mapped = Mapped((Column("q", "position_J", unit="rad", filter=cutoff),), time="t", derived=(*rates, first))
    found = convert_table({"t": time, "q": np.sin(w * time + 0.4)}, mapped, "x")
    log = found.log
    np.testing.assert_allclose(log["twice"], -(w**2) * np.sin(w * log.time + 0.4), atol=0.05 * w**2)
    assert log["position_start_J"][0] == log["position_J"][0]
    assert log.time[0] == pytest.approx(0.5 / cutoff) and any("both ends left out" in note for note in found.notes)


def test_a_filter_tells_how_much_noise_it_leaves_and_asks_for_a_log_beyond_its_ends():
    time, std = 0.002 * np.arange(20_000), 0.3
    noisy = np.sin(time) + std * np.random.default_rng(0).standard_normal(len(time))
    mapped = Mapped((Column("f", "effort_J", unit="N m", filter=20.0),), time="t")
    found = convert_table({"t": time, "f": noisy}, mapped, "x")
    left, twice = found.log["effort_J"] - np.sin(found.log.time), Column("effort_J", "effort_K", take="", filter=20.0)
    assert found.noise is not None and found.noise["effort_J"] == pytest.approx(np.std(left), rel=0.1)
    with pytest.raises(InputError, match="too short for filters"):
        convert_table({"t": time[:45], "f": noisy[:45]}, replace(mapped, derived=(twice,)), "x")


def test_a_case_of_a_log_in_motion_and_one_at_rest_states_the_noise_that_filters_leave(tmp_path):
    time, rng = 0.02 * np.arange(400), np.random.default_rng(0)
    for name, moving in (("moving", 1.0), ("again", 1.0), ("rest", 0.0)):
        angle = moving * (np.sin(time) + 0.01 * rng.standard_normal(400))
        np.savetxt(tmp_path / f"{name}.csv", np.c_[time, angle, 0.0 * time], delimiter=",", header="t,q,f", comments="")
    named = {"q": "angle_J", "f": "zero_J"}
    columns = {key: {"name": name, "unit": "rad", "filter": 5.0} for key, name in named.items()}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({"time": {"column": "t", "unit": "s"}, "columns": columns}))
    files = [tmp_path / f"{name}.csv" for name in ("moving", "again", "rest")]
    assert run("import", *files, "--map", tmp_path / "map.yaml", "--out", tmp_path / "case").exit_code == 0
    noise = yaml.safe_load((tmp_path / "case" / "case.yaml").read_text())["noise"]
    assert list(noise) == ["angle_J"] and noise["angle_J"] == pytest.approx(0.01 * np.sqrt(2 * 5.0 * 0.02), rel=0.3)


@pytest.mark.parametrize(("step", "jitter"), [(0.0013, 0.0), (0.002, 3e-4)])
def test_an_acceleration_is_right_where_the_clock_is_no_whole_number_of_samples_a_frame(step, jitter):
    """Of sin(w t), but for a shift of less than a frame that all columns have."""
    w, time = 4.0 * np.pi, np.arange(0.0, 8.0, step)
    time += np.random.default_rng(0).uniform(-jitter, jitter, len(time))
    rates = (Column("position_J", "velocity_J", take="rate", filter=40.0), Column("velocity_J", "twice", take="rate"))
    mapped = Mapped((Column("q", "position_J", unit="rad"),), time="t", period=0.005, derived=rates)
    found = convert_table({"t": time, "q": np.sin(w * time)}, mapped, "x")
    inner = slice(100, -100)
    angle, wrong = found.log["position_J"][inner], found.log["twice"][inner] + w**2 * found.log["position_J"][inner]
    assert np.std(wrong) < 0.01 * w**2 * np.std(angle)
    assert any("interpolated" in note for note in found.notes)


def test_derivative_and_difference(tmp_path):
    mapping = {
        **MAP,
        "derived": {
            "angle_speed_wrist": {"of": "angle_wrist", "take": "rate"},
            "angle_twist": {"of": "angle_elbow", "minus": "angle_wrist", "scale": 0.5, "offset": 1.0},
            "angle_start_wrist": {"of": "angle_wrist", "take": "first"},
        },
    }
    stream = io.BytesIO()
    savemat(stream, {"run": {"t": TIME, "q": Q}})
    log = imported(tmp_path, stream.getvalue(), mapping, "run.mat")
    np.testing.assert_allclose(log["angle_speed_wrist"][1:-1], 3.0 * np.cos(3.0 * TIME[1:-1]), atol=3**3 * 0.02**2 / 6)
    assert log.units["angle_speed_wrist"] == "rad/s"
    np.testing.assert_allclose(log["angle_twist"], 0.5 * (Q[:, 1] - Q[:, 0]) + 1.0)
    np.testing.assert_array_equal(log["angle_start_wrist"], np.full(N, Q[0, 0]))


@pytest.mark.parametrize("late", [0.137, -0.05, 0.0])
@pytest.mark.parametrize("gain", [2.0, -1.0])
def test_two_clocks_are_brought_together(late, gain):
    rng = np.random.default_rng(3)
    wander = lambda t: sum(np.sin(2 * np.pi * f * t + p) for f, p in zip((0.3, 0.7, 1.9), (0.1, 2.0, 4.0)))  # noqa: E731
    here, there = 0.01 * np.arange(2000), np.sort(rng.uniform(0.0, 20.0, 1500))
    fixed = Track(here, wander(here))
    moved = Track(there, gain * wander(there - late) + 0.05 * rng.standard_normal(1500))
    lag, correlation = find_lag(moved, fixed, 0.5, "x")
    assert lag == pytest.approx(late, abs=2e-3) and correlation > 0.95


def test_sync_moves_the_columns_and_says_so_in_the_case(tmp_path):
    time = 0.01 * np.arange(1500)
    course = np.sin(2.0 * time) + 0.5 * np.sin(5.3 * time)
    late = np.sin(2.0 * (time - 0.2)) + 0.5 * np.sin(5.3 * (time - 0.2))
    rows = "\n".join(f"{t},{a},{b}" for t, a, b in zip(time, course, late))
    (tmp_path / "run.csv").write_text("t,cmd,cam\n" + rows)
    mapping = {
        "time": {"column": "t"},
        "columns": {
            "cmd": {"name": "angle_ref_wrist", "unit": "rad"},
            "cam": {"name": "angle_wrist", "unit": "rad", "filter": 20.0},
        },
        "sync": [{"columns": ["angle_wrist"], "by": "angle_wrist", "with": "angle_ref_wrist", "within": 0.5}],
        "period": 0.01,
    }
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping))
    made = run("import", tmp_path / "run.csv", "--map", tmp_path / "map.yaml", "--out", tmp_path / "log.csv")
    assert made.exit_code == 0 and "note: angle_wrist: moved by -200 ms" in made.output, made.output
    case = read_case(tmp_path / "log.csv", period=0.01)
    assert any("moved by -200 ms" in note for note in case.notes) and any("20 Hz" in note for note in case.notes)
    log = case.logs[0].log
    error = (log["angle_wrist"] - log["angle_ref_wrist"])[100:-100]
    assert np.abs(error).max() < 0.05  # the motion of a frame: frames take the newest sample


@pytest.mark.parametrize(
    ("key", "value", "word"),
    [
        ("derived", {"x": {"of": "angle_wris", "take": "rate"}}, "did you mean angle_wrist"),
        ("derived", {"angle_wrist": {"of": "angle_elbow"}}, "another column"),
        ("derived", {"angle_speed_x": {"of": "angle_elbow", "take": "integral"}}, "none of first, rate"),
        (
            "sync",
            [{"columns": ["angle_wrist"], "by": "angle_elbow", "with": "angle_wrist", "within": 1}],
            "`by` is one",
        ),
        ("sync", [{"columns": ["angle_wrist"], "by": "angle_wrist", "with": "force", "within": 1}], "'force'"),
        ("samples", "diagonal", "rows, columns"),
    ],
)
def test_what_is_wrong_in_a_mapping_is_named(tmp_path, key, value, word):
    with pytest.raises(InputError, match=word):
        imported(tmp_path, "{}", {**MAP, key: value}, "run.json")


@pytest.mark.parametrize(
    ("text", "lacks"),
    [
        ("ms;q\n0;1.5\n20;1.6\n", 'separator: ";"'),
        ("ms\tq\n0\t1.5\n20\t1.6\n", 'separator: "\\t"'),
        ("ms;q\n0;1,5\n20;1,6\n", 'separator: ";" and decimal: ","'),
    ],
)
def test_a_mapping_without_the_separator_is_told_it(tmp_path, text, lacks):
    mapping = {"time": {"column": "ms", "unit": "ms"}, "columns": {"q": {"name": "angle_a", "unit": "rad"}}}
    with pytest.raises(InputError, match=re.escape(f"a mapping file must say {lacks}")):
        imported(tmp_path, text, mapping)
    marks = yaml.safe_load("\n".join(lacks.split(" and ")))
    assert imported(tmp_path, text, mapping | marks)["angle_a"].tolist() == [1.5, 1.6]


def test_the_command_lists_columns_and_makes_a_case_of_several_recordings(tmp_path):
    for k in range(3):
        rows = "\n".join(f"{20 * n};{np.sin(0.1 * n + k):.6f};go" for n in range(50)).replace(".", ",")
        (tmp_path / f"run{k}.csv").write_text("time_ms;q;word\n" + rows)
    listed = run("import", tmp_path / "run0.csv")
    assert listed.exit_code == 0 and "time_ms" in listed.output and "word" not in listed.output
    mapping = {"time": {"column": "time_ms", "unit": "ms"}, "columns": {"q": {"name": "angle_a", "unit": "rad"}}}
    mapping |= {"separator": ";", "decimal": ","}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping))
    files = [tmp_path / f"run{k}.csv" for k in range(3)]
    made = run("import", *files, "--map", tmp_path / "map.yaml", "--out", tmp_path / "case")
    assert made.exit_code == 0, made.output
    case = read_case(tmp_path / "case")
    assert [(item.file, item.role) for item in case.logs][1:] == [("run1.csv.gz", "fit"), ("run2.csv.gz", "holdout")]
    own = run("import", tmp_path / "case" / "run0.csv.gz", "--out", tmp_path / "own.npz")
    assert own.exit_code == 0 and read_log(tmp_path / "own.npz").equals(case.logs[0].log)
    deep = run("import", tmp_path / "case" / "run0.csv.gz", "--out", tmp_path / "new" / "deep" / "t.npz")
    assert deep.exit_code == 0 and len(read_log(tmp_path / "new" / "deep" / "t.npz")) == 50
    assert "a folder without" in run("import", tmp_path / "new").stderr
    refused = run("import", *files, "--map", tmp_path / "map.yaml", "--out", tmp_path / "one.csv")
    assert refused.exit_code == 2 and "3 logs" in refused.stderr


@pytest.mark.parametrize(
    ("text", "names", "last"),
    [
        ("time [s],angle of wrist [rad],q\n0,1.0,7\n0.1,2.0,8\n", ["time [s]", "angle of wrist [rad]", "q"], 8.0),
        ("t;a\n0,5;1,5\n0,6;2,5\n", ["t", "a"], 2.5),
        ("t a\n0 1\n1 2\n", ["t", "a"], 2.0),
        ("0\t1.5\n1\t-2.5\n", ["0", "1"], -2.5),
        ('t,q,note\n0,"[1, 2]",left arm\n1,"[3, 4]",left arm\n', ["t", "q[0]", "q[1]"], 4.0),
        ("t\n1\n2\n", ["t"], 2.0),
    ],
)
def test_the_marks_of_a_text_table_are_guessed(text, names, last):
    found = list_columns(text.encode(), "table.txt")
    assert list(found) == names and found[names[-1]][-1] == last


def test_missing_samples_are_counted_and_a_wrong_unit_of_time_is_asked_about(tmp_path):
    mapping = {"time": {"column": "t", "unit": "ms"}, "columns": {"a": {"name": "angle_a", "unit": "rad"}}}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping | {"period": 0.02}))
    for step, name in ((20, "right.csv"), (0.02, "wrong.csv")):
        rows = [f"{step * n},{'nan' if n in (3, 50) else 0.5}" for n in range(100)]
        (tmp_path / name).write_text("\n".join(["t,a", *rows]))
    mapped = read_mapping(tmp_path / "map.yaml")
    notes = import_recording(tmp_path / "right.csv", mapped).notes
    assert "a: 2 of 100 samples are missing, the first in row 4" in notes
    with pytest.raises(InputError, match=r"100 samples in 0.00198 s; is the unit of time right"):
        import_recording(tmp_path / "wrong.csv", mapped)


def test_a_short_heading_is_not_taken_for_another_separator(tmp_path):
    columns = {"b": {"name": "angle_b", "unit": "rad"}}
    with pytest.raises(InputError, match="no column 'b'") as caught:
        imported(tmp_path, "t;a\n", {"separator": ";", "time": {"column": "t", "unit": "s"}, "columns": columns})
    assert "lacks" not in str(caught.value)


def test_a_period_that_is_not_the_machines_frame_is_said_at_once(tmp_path):
    """The wrist's frame has 1 s."""
    time = 0.04 * np.arange(1000)
    rows = np.column_stack([time, *(np.sin(time + k) for k in range(3))])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,q4,q5,q6", comments="")
    columns = {f"q{k}": {"name": f"angle_q{k}", "unit": "rad"} for k in (4, 5, 6)}
    for period, said in ((0.04, True), (1.0, False)):
        mapping = {"time": {"column": "t"}, "columns": columns, "period": period}
        (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping))
        place = tmp_path / f"case_{said}"
        made = run(
            "import", tmp_path / "run.csv", "--machine", "dvrk_wrist", "--map", tmp_path / "map.yaml", "--out", place
        )
        assert made.exit_code == 0 and ("state period: 1" in made.output) == said, made.output
