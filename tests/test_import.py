"""Foreign recordings of every kind: nested values, either way round, bags, data sets, derived columns, two clocks."""

import io
import json
import re

import numpy as np
import pytest
import yaml
from bags import BAG, TIME, N, Q, json_mcap, sqlite_bag
from command_line import run
from mcap_ros2.writer import Writer as RosWriter
from scipy.io import savemat

from exodrake.core.errors import InputError
from exodrake.core.units import default_unit
from exodrake.data.case import read_case
from exodrake.data.formats import read_log, write_log
from exodrake.data.import_log import Track, find_lag, import_all, import_log, import_recording, low_pass, read_mapping
from exodrake.data.log import Log
from exodrake.data.tables import list_columns
from exodrake.diagnosis.checks.compare import check_case
from exodrake.machines.robot_file import load_robot

MAP = {
    "time": {"column": "run.t", "unit": "s"},
    "columns": {"run.q[1]": {"name": "angle_elbow", "unit": "rad"}, "run.q[0]": {"name": "angle_wrist", "unit": "rad"}},
}


NAMES = ("angle_wrist", "angle_elbow")


def imported(folder, content: bytes, name: str, mapping=MAP):
    (folder / "map.yaml").write_text(yaml.safe_dump(mapping))
    (folder / name).write_bytes(content)
    return import_log(folder / name, folder / "map.yaml")


def check(log) -> None:
    """The log holds both angles."""
    np.testing.assert_allclose(log.time, TIME, atol=1e-12)
    np.testing.assert_array_equal(log.array("angle", ("wrist", "elbow")), Q)


@pytest.mark.parametrize("turned", [False, True])
def test_a_matlab_struct_either_way_round(tmp_path, turned):
    stream = io.BytesIO()
    savemat(stream, {"run": {"t": TIME, "q": Q.T if turned else Q, "note": "left arm", "cal": {"k": 2.0}}})
    check(imported(tmp_path, stream.getvalue(), "run.mat"))


def test_arrays_of_structs_and_cells_have_an_index(tmp_path):
    stream = io.BytesIO()
    cell = np.empty(2, dtype=object)
    cell[:] = [np.zeros(3), Q]
    savemat(stream, {"trial": [{"t": TIME}, {"t": 1.0 + TIME}], "c": cell})
    mapping = {
        "time": {"column": "trial[1].t"},
        "columns": {"c[1][0]": {"name": "angle_wrist", "unit": "rad"}},
    }
    log = imported(tmp_path, stream.getvalue(), "run.mat", mapping)
    np.testing.assert_array_equal(log.time, 1.0 + TIME)
    np.testing.assert_array_equal(log["angle_wrist"], Q[:, 0])


def test_a_square_matrix_is_read_as_the_mapping_says(tmp_path):
    stream, square = io.BytesIO(), np.arange(9.0).reshape(3, 3)
    np.savez(stream, t=np.arange(3.0), q=square)
    for side, wanted in (("rows", square[:, 1]), ("columns", square[1])):
        mapping = {"time": {"column": "t"}, "columns": {"q[1]": {"name": "force_x", "unit": "N"}}, "samples": side}
        np.testing.assert_array_equal(imported(tmp_path, stream.getvalue(), "q.npz", mapping)["force_x"], wanted)


@pytest.mark.parametrize("matlab", [False, True])
def test_hdf5_and_matlab_7_3(tmp_path, matlab):
    h5py = pytest.importorskip("h5py")
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
    check(imported(tmp_path, content, "run.mat" if matlab else "run.h5"))
    slashes = {**MAP, "time": {"column": "/run/t"}}
    check(imported(tmp_path, content, "run.mat" if matlab else "run.h5", slashes))


def test_json_objects_records_and_lines(tmp_path):
    whole = {"run": {"t": TIME.tolist(), "q": Q.tolist(), "who": "me"}}
    check(imported(tmp_path, json.dumps(whole).encode(), "run.json"))
    rows = [{"t": t, "q": q, "ok": True} for t, q in zip(TIME.tolist(), Q.tolist(), strict=True)]
    check(imported(tmp_path, json.dumps({"run": rows}).encode(), "run.json"))
    lines = "\n".join(json.dumps({"run": row}) for row in rows).encode()
    check(imported(tmp_path, lines, "run.jsonl"))
    for spoilt, word in ((b"[" * 100_000, "deep"), (b"{", "not JSON"), (b"3", "one value")):
        with pytest.raises(InputError, match=word):
            imported(tmp_path, spoilt, "run.json")


@pytest.mark.parametrize("definitions", [False, True])
def test_a_bag_in_sqlite(tmp_path, definitions):
    folder = tmp_path / "bag"
    folder.mkdir()
    sqlite_bag(folder / "bag_0.db3", definitions)
    mapping = {
        "time": {"start": 0},
        "columns": {f"/joint_states:position[{j}]": {"name": f"angle_{j}", "unit": "rad"} for j in ("wrist", "elbow")},
    }
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping))
    check(import_log(folder, tmp_path / "map.yaml"))
    check(import_log(folder / "bag_0.db3", tmp_path / "map.yaml"))


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
    mapped = imported(tmp_path, (tmp_path / "log.mcap").read_bytes(), "log.mcap", mapping)
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
    log = imported(tmp_path, (tmp_path / "run.mcap").read_bytes(), "run.mcap", mapping)
    check(log)
    np.testing.assert_allclose(log["angle_ref_wrist"], np.radians(Q[:, 0]))


def test_json_messages_have_foxgloves_stamp_and_are_refused_by_topic(tmp_path):
    stamp = [{"timestamp": {"sec": 7, "nsec": round(1e9 * t)}, "q": q[0]} for t, q in zip(TIME[:40], Q)]
    content = json_mcap([("/state", 5.0 + 0.1 * k, state) for k, state in enumerate(stamp)])
    mapping = {"columns": {"/state:q": {"name": "angle_wrist", "unit": "rad"}}, "stamp": "header", "period": 0.02}
    log = imported(tmp_path, content, "run.mcap", mapping)
    np.testing.assert_allclose(log.time[[0, -1]], [7.0, 7.0 + TIME[-1]])
    for key, said in (("/state:speed", "topic '/state' has no field 'speed'"), ("/state:timestamp", "is not a number")):
        wrong = {**mapping, "columns": {key: {"name": "angle_wrist", "unit": "rad"}}}
        with pytest.raises(InputError, match=re.escape(said)):
            imported(tmp_path, content, "run.mcap", wrong)


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
    log = imported(tmp_path, stream.getvalue(), "run.mcap", mapping)
    check(log)
    listed = run("import", tmp_path / "run.mcap").output
    assert "motors[0].turns" in listed and "motors[1].turns" in listed and "label" not in listed


@pytest.mark.parametrize("version", [2, 3])
def test_a_lerobot_data_set(tmp_path, version):
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    names = ["wrist_flex.pos", "elbow_flex.pos"]
    feature = {"dtype": "float32", "shape": [2], "names": names if version == 3 else {"motors": names}}
    info = {"fps": 50, "features": {"action": feature, "observation.state": feature}}
    (tmp_path / "set" / "meta").mkdir(parents=True)
    (tmp_path / "set" / "meta" / "info.json").write_text(json.dumps(info))
    folder = tmp_path / "set" / "data" / "chunk-000"
    folder.mkdir(parents=True)
    tables = []
    for episode in range(3):
        columns = {"action": (10.0 * Q).tolist(), "observation.state": (10.0 * Q + episode).tolist()}
        columns |= {"timestamp": TIME.tolist(), "episode_index": [episode] * N}
        tables.append(arrow.table(columns))
    if version == 3:
        parquet.write_table(arrow.concat_tables(tables), folder / "file-000.parquet")
    else:
        for episode, table in enumerate(tables):
            parquet.write_table(table, folder / f"episode_{episode:06d}.parquet")
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


def test_a_counter_that_starts_again_is_made_continuous_with_its_sign(tmp_path):
    turns = np.linspace(0.0, 3.0, N)
    text = "t,count\n" + "\n".join(f"{t},{c}" for t, c in zip(TIME, np.floor(4096 * turns) % 4096))
    column = {"name": "angle_wheel", "unit": "rev", "scale": 1 / 4096, "sign": -1, "wrap": 4096}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({"time": {"column": "t"}, "columns": {"count": column}}))
    (tmp_path / "c.csv").write_text(text)
    found = import_recording(tmp_path / "c.csv", read_mapping(tmp_path / "map.yaml"))
    np.testing.assert_allclose(found.log["angle_wheel"], -2 * np.pi * turns, atol=2 * np.pi / 4096)
    assert found.notes == ("angle_wheel: made continuous where readings start again after 4096, sign turned",)


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
    log = imported(tmp_path, stream.getvalue(), "run.mat", mapping)
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
        imported(tmp_path, b"{}", "run.json", {**MAP, key: value})


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
    with pytest.raises(InputError, match=re.escape(f"the mapping file lacks {lacks}")):
        imported(tmp_path, text.encode(), "run.csv", mapping)
    marks = yaml.safe_load("\n".join(lacks.split(" and ")))
    assert imported(tmp_path, text.encode(), "run.csv", mapping | marks)["angle_a"].tolist() == [1.5, 1.6]


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


def test_the_folder_of_a_log_is_made_and_a_folder_without_recording_is_named(tmp_path):
    (tmp_path / "t.csv").write_text("time [s],force_x [N]\n0,1\n1,2\n")
    made = run("import", tmp_path / "t.csv", "--out", tmp_path / "new" / "deep" / "t.npz")
    assert made.exit_code == 0 and len(read_log(tmp_path / "new" / "deep" / "t.npz")) == 2
    for words in ((), ("--out", tmp_path / "x.csv")):
        assert "a folder without" in run("import", tmp_path / "new", *words).stderr


@pytest.mark.parametrize("numbers", [[[0.0]] * 2, [0.0, float("nan")]])
def test_episodes_of_a_data_set_without_one_number_a_row_are_refused(tmp_path, numbers):
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    (tmp_path / "meta").mkdir()
    (tmp_path / "data").mkdir()
    (tmp_path / "meta" / "info.json").write_text(json.dumps({"fps": 50, "features": {}}))
    parquet.write_table(
        arrow.table({"timestamp": [0.0, 0.1], "episode_index": numbers}), tmp_path / "data" / "a.parquet"
    )
    assert "'episode_index': wanted one number" in run("import", tmp_path).stderr


def test_jitter_of_a_clock_with_a_sample_a_frame_neither_loses_nor_repeats_samples(tmp_path):
    """A sine of half a hertz on a clock of 20 ms that errs by 0.1 ms (RMS): 0.07 mrad at most on the mean."""
    rng, frame = np.random.default_rng(0), 0.02
    time = frame * np.arange(1000) + 1e-4 * rng.standard_normal(1000)
    rows = [f"{t:.7f},{0.3 * np.sin(np.pi * t):.9f}" for t in time]
    (tmp_path / "run.csv").write_text("t,x\n" + "\n".join(rows) + "\n")
    mapping = {"time": {"column": "t", "unit": "s"}, "columns": {"x": {"name": "angle_x", "unit": "rad"}}}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping | {"period": frame}))
    log = import_log(tmp_path / "run.csv", tmp_path / "map.yaml")
    angle = log["angle_x"]
    assert np.isfinite(angle).all() and np.all(np.diff(angle) != 0.0)
    assert np.sqrt(np.mean((angle - 0.3 * np.sin(np.pi * (log.time + time[0]))) ** 2)) < 1e-4


def test_recording_of_a_single_row_is_one_frame_without_a_warning(tmp_path, recwarn):
    (tmp_path / "run.csv").write_text("t,x\n0.1,0.5\n")
    mapping = {"time": {"column": "t", "unit": "s"}, "columns": {"x": {"name": "angle_x", "unit": "rad"}}}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(mapping | {"period": 0.02}))
    assert import_log(tmp_path / "run.csv", tmp_path / "map.yaml")["angle_x"].tolist() == [0.5] and not recwarn.list


def recorded_case(folder, step: float, machine, **stated):
    """The case that `import` makes of a recording of a machine whose clock errs by 0.5 ms (RMS)."""
    rng = np.random.default_rng(4)
    columns = machine.log_names(column for column in machine.columns if column.required)
    time = step * np.arange(300) + 5e-4 * rng.standard_normal(300)
    table = np.column_stack([time, rng.standard_normal((300, len(columns)))])
    np.savetxt(folder / "run.csv", table, "%.9f", ",", header=",".join(("t", *columns)), comments="")
    named = {name: {"name": name, "unit": default_unit(name)} for name in columns}
    (folder / "map.yaml").write_text(yaml.safe_dump({"time": {"column": "t"}, "columns": named, **stated}))
    made = run("import", folder / "run.csv", "--map", folder / "map.yaml", "--out", folder / "case")
    assert made.exit_code == 0, made.output
    return read_case(folder / "case")


def test_a_case_on_about_the_clock_of_the_machine_has_its_frames(tmp_path):
    machine = load_robot().machine
    case = recorded_case(tmp_path, 0.0200033, machine)
    assert case.period == machine.frame == 0.02
    check_case(case, machine)


@pytest.mark.parametrize(("step", "stated", "period"), [(0.05, {}, 0.05), (0.02, {"period": 0.021}, 0.021)])
def test_a_case_on_another_clock_keeps_its_own_period_and_a_stated_one_holds(tmp_path, step, stated, period):
    case = recorded_case(tmp_path, step, load_robot().machine, **stated)
    assert case.period == pytest.approx(period, rel=0.01) and (not stated or case.period == period)
