"""No sample of a recording is lost, doubled or moved without a word: refused in one sentence, or counted in a note."""

import io
import sqlite3
import zipfile

import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest
from bags import JOINT_STATE, RosWriter, lerobot, sqlite_bag
from mcap.reader import make_reader
from mcap.writer import Writer
from scipy.io import savemat

import exodrake as exo
from exodrake.core.errors import InputError
from exodrake.data.import_log import Column, Mapped, frame_period, import_all, import_recording, read_mapping
from exodrake.data.log import Log, regularise
from exodrake.monitor.watcher import Grid, Rows

N = 100
EVEN = 0.02 * np.arange(N)
RESTART = np.concatenate([EVEN[:50], EVEN[:50]])
BACK = np.where(np.arange(N) < 60, EVEN, EVEN - 0.5)
POSITION = "/joint_states:position[MCP]"
TABLE = Mapped((Column("x", "tension_AF", "N"),), time="t")


def refusal(function, *arguments, **options):
    with pytest.raises(InputError) as caught:
        function(*arguments, **options)
    said = str(caught.value)
    assert "\n" not in said and len(said) < 400
    return said


def ros_bag(path, stamps, logged=None, numbers=None, order=None, joints=None):
    """A bag of joint states whose n-th message holds position n; in the order given."""
    stream = io.BytesIO()
    writer = RosWriter(stream)
    kind = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
    for n in range(len(stamps)) if order is None else order:
        sec, nanosec = divmod(round(stamps[n] * 1e9), 10**9)
        time = round((1000.0 + (EVEN if logged is None else logged)[n]) * 1e9)
        names = ["MCP"] if joints is None else joints[n]
        state = {"header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": ""}, "name": names}
        state |= {"position": [float(n)] * len(names), "velocity": [], "effort": []}
        sequence = 0 if numbers is None else numbers[n]
        writer.write_message("/joint_states", kind, state, log_time=time, publish_time=time, sequence=sequence)
    writer.finish()
    path.write_bytes(stream.getvalue())
    return path


def mapped(stamp):
    return Mapped((Column(POSITION, "angle_MCP", "rad"),), start=0.0, stamp=stamp)


@pytest.mark.parametrize("clock", ["header", "log"])
@pytest.mark.parametrize(
    ("stamps", "said"),
    [(RESTART, "backwards by 0.98 s, at message 51"), (BACK, "backwards by 0.48 s, at message 61"),
     (EVEN[::-1], "backwards by 1.98 s"), (np.zeros(N), "stands still, all 100 messages"),
     (np.where(EVEN > 1.0, EVEN + 1e5, EVEN), "where its clock jumps")],
    ids=["restarts", "back", "reversed", "still", "jumps far"],
)  # fmt: skip
def test_a_bag_whose_clock_goes_wrong_is_refused(tmp_path, clock, stamps, said):
    given = {"stamps": stamps} if clock == "header" else {"stamps": EVEN, "logged": stamps}
    assert said in refusal(import_all, ros_bag(tmp_path / "a.mcap", **given), mapped(clock))


def test_a_sqlite_bag_whose_recorder_steps_back_is_refused(tmp_path):
    path = tmp_path / "a.db3"
    sqlite_bag(path, definitions=False)
    with sqlite3.connect(path) as bag:
        bag.execute("UPDATE messages SET timestamp = timestamp - 300000000 WHERE id > 20 AND id <= 40")
    only = Mapped((Column("/joint_states:position[wrist]", "angle_wrist", "rad"),))
    assert "backwards by 0.28 s, at message 21" in refusal(import_all, path, only)


@pytest.mark.parametrize("name", ["messages", "topics", "Messages"])
def test_a_sqlite_bag_of_views_is_refused_before_it_is_read(tmp_path, name):
    """A view may be recursive and have no end."""
    path = tmp_path / "a.db3"
    sqlite_bag(path, definitions=False)
    with sqlite3.connect(path) as bag:
        bag.execute(f"ALTER TABLE {name} RENAME TO theirs")
        bag.execute(f"CREATE VIEW {name} AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i FROM n) SELECT i id, "
                    "1 topic_id, i timestamp, i data, '' name, '' type FROM n")  # fmt: skip
    assert f"{name.lower()!r} is no table" in refusal(import_all, path, mapped("log"))


def test_messages_that_a_bag_holds_in_another_order_are_put_in_that_of_their_numbers(tmp_path):
    order = np.random.default_rng(0).permutation(N)
    path = ros_bag(tmp_path / "a.mcap", EVEN, numbers=range(N), order=order)
    for clock in ("header", "log"):
        found = import_all(path, mapped(clock))["a"]
        assert found.log["angle_MCP"].tolist() == list(range(N)) and found.notes == ()


def test_a_bag_of_eleven_files_is_read_in_order(tmp_path):
    for k in range(12):
        ros_bag(tmp_path / f"bag_{k}.mcap", EVEN + 2.0 * k, logged=EVEN + 2.0 * k)
    assert import_all(tmp_path, mapped("log"))[tmp_path.name].log["angle_MCP"].tolist() == 12 * list(range(N))


def test_lost_and_late_messages_are_counted(tmp_path):
    late = EVEN.copy()
    late[60] = late[59] - 0.005
    (late_note, frames) = import_all(ros_bag(tmp_path / "a.mcap", late), mapped("header"))["a"].notes
    assert "1 message out of order, the first is message 61 at 1.175 s" in late_note
    assert "100 samples on 100 frames" in frames and "1 dropped for a newer one" in frames
    kept = np.delete(EVEN, range(30, 35))
    (lost,) = import_all(ros_bag(tmp_path / "b.mcap", kept), mapped("header"))["b"].notes
    assert "95 samples on 100 frames" in lost and "4 left empty, the first at 0.62 s" in lost
    (jump,) = import_all(ros_bag(tmp_path / "c.mcap", EVEN + 100.0 * (EVEN > 1.0)), mapped("header"))["c"].notes
    assert "100 samples on 5100 frames" in jump and "4999 left empty" in jump


def test_joints_of_two_publishers_on_a_topic_are_both_whole_and_one_that_is_named_twice_is_refused(tmp_path):
    path = ros_bag(tmp_path / "a.mcap", np.repeat(EVEN[:50], 2), joints=[["MCP"], ["PIP"]] * 50)
    assert import_all(path, mapped("header"))["a"].log["angle_MCP"].tolist() == list(range(0, N, 2))
    assert "twice" in refusal(
        import_all, ros_bag(tmp_path / "b.mcap", EVEN, joints=[["MCP", "MCP"]] * N), mapped("log")
    )


def table(path, time, mark=""):
    path.write_text("t,x\n" + "".join(f"{t!r},{k}{mark}\n" for k, t in enumerate(np.asarray(time).tolist())))
    return path


@pytest.mark.parametrize("period", [None, 0.02])
@pytest.mark.parametrize(
    ("time", "said"),
    [(RESTART, "row 51: 0 s"), (BACK, "row 61"), (EVEN[::-1], "row 2"), (np.ones(N), "stands still, all 100 rows")],
    ids=["restarts", "back", "reversed", "still"],
)
def test_a_table_whose_clock_goes_wrong_is_refused(tmp_path, time, said, period):
    given = Mapped(TABLE.columns, time="t", period=period)
    assert said in refusal(import_recording, table(tmp_path / "a.csv", time), given)


def test_rows_at_a_time_that_was_there_are_counted(tmp_path):
    time = EVEN.copy()
    time[30:35] = time[30]
    (note,) = import_recording(table(tmp_path / "a.csv", time), TABLE).notes
    assert note == "4 of 100 rows have the time of the row before and are dropped, the first is row 32 at 0.6 s"


def test_samples_that_frames_drop_or_repeat_are_counted(tmp_path):
    given = Mapped(TABLE.columns, time="t", period=0.02)
    (fast,) = import_recording(table(tmp_path / "a.csv", EVEN / 10), given).notes
    assert "100 samples on 10 frames of 20 ms: 90 dropped" in fast
    (slow,) = import_recording(table(tmp_path / "a.csv", EVEN * 1.25), given).notes
    assert "100 samples on 124 frames of 20 ms: 24 repeat the sample before" in slow and "tension_AF" in slow
    both = Mapped((*TABLE.columns, Column("x", "tension_MF", "N")), time="t", period=0.02)
    (said,) = import_recording(table(tmp_path / "a.csv", EVEN / 10), both).notes
    assert "all columns: 100 samples on 10 frames" in said and "tension" not in said


@pytest.mark.parametrize("last", [-4e-4, 4e-4])
def test_jitter_of_the_clock_loses_no_sample(tmp_path, last):
    time = EVEN + np.random.default_rng(0).uniform(-5e-4, 5e-4, N)
    time[[0, -1]] = 0.0, EVEN[-1] + last
    found = import_recording(table(tmp_path / "a.csv", time), Mapped(TABLE.columns, time="t", period=0.02))
    assert next(iter(found.log.signals.values())).tolist() == list(range(N)) and found.notes == ()


LONG = 0.02 * np.arange(3000)


def log_at(time):
    time = np.asarray(time)
    return Log(time, {"tension_AF": np.arange(float(len(time)))}, source="a.csv")


@pytest.mark.parametrize(
    "time",
    [LONG * 0.99, LONG * 1.01, LONG * 1.25, LONG * 0.6, LONG * 1.49, LONG[:60] * 1.25, LONG[:200] * 1.01,
     np.concatenate([LONG * 1.01, LONG[-1] * 1.01 + 0.99 * (LONG + 0.02)]), LONG + 0.3 * np.sin(0.3 * LONG)],
    ids=["1 % fast", "1 % slow", "40 Hz", "83 Hz", "34 Hz", "40 Hz, short", "1 % slow, short", "fast after slow",
         "wanders"],
)  # fmt: skip
def test_a_clock_of_another_rate_is_refused(time):
    assert "no multiple of the frame of 20 ms" in refusal(regularise, log_at(time))


def test_jitter_a_slip_and_a_clock_as_good_as_a_computers_are_set_on_the_grid():
    jitter = LONG + np.random.default_rng(0).uniform(-0.004, 0.004, len(LONG))
    for time in (jitter, LONG * 1.0005, np.where(LONG > 30.0, LONG + 0.008, LONG), np.round(LONG, 2), LONG[::2]):
        log, _ = regularise(log_at(time))
        assert log["tension_AF"][~np.isnan(log["tension_AF"])].tolist() == list(range(len(time)))


def test_a_case_of_another_rate_takes_the_frame_of_its_clock():
    """30 Hz in whole milliseconds: 33, 33, 34 ms; their median is 1 % short."""
    rounded = log_at(np.round(np.arange(600) / 30.0, 3))
    assert frame_period([rounded], None, 0.02) == pytest.approx(1 / 30, rel=1e-4)
    assert frame_period([log_at(EVEN)], None, 0.02) == 0.02
    assert frame_period([log_at(LONG * 0.97)], None, 0.02) == pytest.approx(0.0194, rel=1e-6)
    regularise(rounded, frame_period([rounded], None, 0.02))


def test_a_log_that_grows_at_another_rate_is_refused():
    grid, rows = Grid("a.csv", 0.02), np.column_stack([LONG * 0.99, np.arange(len(LONG))])
    assert "19.8 ms by its clock, not 20 ms" in refusal(lambda: list(grid.push(Rows(rows, True, range(len(rows))))))
    even = np.column_stack([LONG, np.arange(len(LONG))])
    assert sum(len(f.values) for f in Grid("a.csv", 0.02).push(Rows(even, True, range(len(even))))) == len(LONG)


def own_mcap(path, change):
    """A log of ours whose messages [topic, number, time, text] a change may lose or turn round."""
    signals = {"tension_AF": np.arange(8.0), "stroke_AF": 10.0 + np.arange(8.0)}
    exo.write_log(Log(0.02 * np.arange(8), signals), path)
    reader, stream = make_reader(io.BytesIO(path.read_bytes())), io.BytesIO()
    writer = Writer(stream)
    writer.start(library="exodrake")
    stored = [[channel.topic, m.sequence, m.log_time, m.data] for _, channel, m in reader.iter_messages()]
    numbers = {t: writer.register_channel(t, "json", 0) for t in dict.fromkeys(item[0] for item in stored)}
    for topic, number, time, text in change(stored):
        writer.add_message(numbers[topic], log_time=time, publish_time=time, data=text, sequence=number)
    for record in reader.iter_metadata():
        writer.add_metadata(record.name, record.metadata)
    writer.finish()
    path.write_bytes(stream.getvalue())
    return path


def lost(rows):
    return lambda stored: [item for item in stored if (item[0], item[1]) not in rows]


def test_messages_of_our_mcap_stand_by_their_numbers(tmp_path):
    def turned(stored):
        return sorted(stored, key=lambda item: -item[1] if item[0] == "/tension" else item[1])

    log = exo.read_log(own_mcap(tmp_path / "a.mcap", turned))
    assert log["tension_AF"].tolist() == list(range(8)) and log["stroke_AF"].tolist() == list(range(10, 18))
    unnumbered = own_mcap(tmp_path / "b.mcap", lambda stored: [[t, 0, time, d] for t, _, time, d in stored[::-1]])
    assert exo.read_log(unnumbered)["tension_AF"].tolist() == list(range(8))


def test_a_message_that_our_mcap_lost_is_named(tmp_path):
    said = refusal(exo.read_log, own_mcap(tmp_path / "a.mcap", lost({("/tension", 2), ("/stroke", 5)})))
    assert "topic '/stroke': a message is missing that other topics have, the first is message 5 at 0.1 s" in said
    twice = own_mcap(tmp_path / "b.mcap", lambda stored: [*stored, stored[-1]])
    assert "message 7 comes twice" in refusal(exo.read_log, twice)
    whole = {(topic, 3) for topic in ("/time", "/tension", "/stroke")}
    assert exo.read_log(own_mcap(tmp_path / "c.mcap", lost(whole))).time.tolist() == [
        0.0, 0.02, 0.04, 0.08, 0.1, 0.12, 0.14
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("decimal", "cell"), [(",", "1.234"), (",", "1.234,5"), (",", "1_0"), (".", "1_0"), (".", "1,234"), (",", "1'0"),
                          (".", "１2"), (".", "1e1_0")],
)  # fmt: skip
def test_a_number_with_marks_between_its_digits_is_refused(tmp_path, decimal, cell):
    path = tmp_path / "a.csv"
    path.write_text(f"t;x\n0;999{decimal}5\n1;{cell}\n")
    given = Mapped(TABLE.columns, time="t", separator=";", decimal=decimal)
    assert f"column 'x', row 2: {cell!r} is not a number" in refusal(import_recording, path, given)


def npz_bytes(*names):
    """Arrays of these names, which may come twice."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for k, name in enumerate(names):
            stream = io.BytesIO()
            np.save(stream, np.arange(3.0) + k)
            archive.writestr(name, stream.getvalue())
    return out.getvalue()


def mat_bytes():
    """Two files in one, each with a variable x; the header takes 128 bytes."""
    one, two = io.BytesIO(), io.BytesIO()
    savemat(one, {"t": np.arange(3.0), "x": np.arange(3.0)})
    savemat(two, {"x": np.ones(3)})
    return one.getvalue() + two.getvalue()[128:]


def parquet_bytes(*names):
    stream = io.BytesIO()
    parquet.write_table(arrow.table([arrow.array(np.arange(3.0) + k) for k in range(3)], names=names), stream)
    return stream.getvalue()


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(
    ("ending", "content"),
    [
        ("json", lambda: b'{"a": {"t": 1, "t": 2}}'), ("json", lambda: b'{"run": {"x": [1, 2]}, "run.x": [3, 4]}'),
        ("json", lambda: '{"t": [0, 1], "x\u200b": [1, 2], "x": [1, 3]}'.encode()), ("mat", mat_bytes),
        ("npz", lambda: npz_bytes("t.npy", "x.npy", "x.npy")), ("npz", lambda: npz_bytes("t.npy", "x", "x.npy")),
        ("npz", lambda: npz_bytes("t.npy", "x\u200b.npy", "x.npy")), ("parquet", lambda: parquet_bytes("t", "x", "x")),
        ("parquet", lambda: parquet_bytes("t", "x", "x\ufeff")),
    ],
)  # fmt: skip
def test_a_name_that_comes_twice_in_a_file_is_refused(tmp_path, ending, content):
    (tmp_path / f"a.{ending}").write_bytes(content())
    assert "comes twice" in refusal(import_recording, tmp_path / f"a.{ending}", TABLE)


def test_an_episode_in_two_files_and_joints_that_become_one_are_refused(tmp_path):
    twice = lerobot(tmp_path / "set", {"chunk-000/a.parquet": [0], "chunk-001/a.parquet": [0]})
    assert "episode 0 is also in data/chunk-000/a.parquet" in refusal(import_all, twice, None, "deg")
    for k, names in enumerate([("a.pos", "a.pos"), ("a.pos", "a")]):
        alike = lerobot(tmp_path / f"{k}", {"a.parquet": [0]}, names)
        assert "comes twice" in refusal(import_all, alike, None, "deg")


@pytest.mark.parametrize(
    ("other", "said"),
    [("tension_AF", "comes twice"), ("tension_AF\u200b", "comes twice"), ("tension\u00ad_AF", "comes twice"),
     ("tension_A\ufeffF", "comes twice"), ("tension_af", "in other letters"), ("Tension_AF", "in other letters"),
     ("TENSION_MF", "did you mean 'tension_MF'"), ("tension_ＡＦ", "in other letters")],
)  # fmt: skip
def test_a_column_that_looks_like_another_is_refused(tmp_path, other, said):
    path = tmp_path / "a.csv"
    path.write_text(f"time [s],tension_AF [N],{other} [N]\n0,1,2\n0.02,1,2\n")
    assert said in refusal(exo.read_log, path)


@pytest.mark.parametrize("cutoff", ["5e-324", "1e-12", "1e-300", "0.4"])
def test_a_filter_slower_than_the_log_is_refused(tmp_path, cutoff):
    (tmp_path / "m.yaml").write_text(
        f"time: {{column: t}}\ncolumns:\n  x: {{name: tension_AF, unit: N, filter: {cutoff}}}\n"
    )
    said = refusal(import_recording, table(tmp_path / "a.csv", EVEN), read_mapping(tmp_path / "m.yaml"))
    assert "wanted above one period in the log" in said
