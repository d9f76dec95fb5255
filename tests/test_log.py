"""The log: read as it was written or refused by file, column and row, in every format; two logs compared."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from hypothesis import HealthCheck, example, given, settings, strategies as st

import exodrake as exo
from exodrake.core.errors import InputError
from exodrake.data.formats import formats, read_log, write_log
from exodrake.data.log import MODEL, Log, compare, regularise
from exodrake.model.units import COMMON, KINDS, UNITS, read_unit

HEADING = "time [s],tension_ref_AF [N],tension_AF [N],stroke_AF [m]"
GOOD = HEADING + "\n0,1,1.5,0.001\n0.02,1,,0.002\n0.04,1,1.25,0.003\n"
NEEDED = ("tension_ref", "tension", "stroke")


@pytest.fixture
def log() -> Log:
    """Fifty frames of two wires and a joint, with holes and awkward floats."""
    draw = np.random.default_rng(3)
    time_ = 0.02 * np.arange(50) - 1 / 3
    columns = ("tension_ref_AF", "tension_ref_MF", "tension_AF", "tension_MF", "stroke_AF", "stroke_MF", "angle_MCP")
    signals = {name: draw.normal(size=50) * 10.0 ** draw.integers(-300, 12) for name in columns}
    signals["tension_AF"][7:9] = np.nan
    signals["stroke_AF"][0] = 5e-324
    return Log(time_, signals)


def save(folder, text, name="log.csv"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refusal(path, **options) -> str:
    with pytest.raises(InputError) as caught:
        read_log(path, **({"required": NEEDED} | options))
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
    return str(caught.value)


def test_columns_come_by_kind_and_name(log):
    assert log.names("tension") == ("AF", "MF")
    assert log.names("tension_ref") == ("AF", "MF")
    assert log.kinds == ("tension_ref", "tension", "stroke", "angle")
    np.testing.assert_array_equal(log.array("stroke", ("MF", "AF"))[:, 0], log["stroke_MF"])
    assert log.array("angle").shape == (50, 1)
    assert log.has("angle") and log.has("angle_MCP") and not log.has("speed_cmd")
    assert log.dt == pytest.approx(0.02, abs=1e-12) and log.duration == pytest.approx(1.0)
    with pytest.raises(InputError, match="stroke_AE"):
        log.array("stroke", ("AF", "AE"))


def test_with_signals_leaves_the_log_alone(log):
    more = log.with_array("speed_cmd", ("AF", "MF"), np.zeros((50, 2)))
    assert more.names("speed_cmd") == ("AF", "MF") and more.units["speed_cmd_AF"] == "m/s"
    assert not log.has("speed_cmd")
    with pytest.raises(InputError, match="glow"):
        log.with_signals({"glow_AF": np.zeros(50)})
    assert log.with_signals({"glow_AF": np.zeros(50)}, {"glow_AF": "W"}).units["glow_AF"] == "W"


@pytest.mark.parametrize(
    ("heading", "cell", "value"),
    [
        ("tension_AF [mN]", "1500", 1.5),
        ("stroke_AF [mm]", "2.1", 0.0021),
        ("angle_MCP [deg]", "180", np.pi),
        ("speed_cmd_AF [mm/s]", "30", 0.03),
        ("velocity_1 [rpm]", "60", 2 * np.pi),
        ("torque_1 [mNm]", "80", 0.08),
    ],
)
def test_units_are_converted_at_the_door(tmp_path, heading, cell, value):
    path = save(tmp_path, f"time [ms],{heading}\n0,{cell}\n20,{cell}\n")
    log = read_log(path)
    assert log.dt == 0.02
    assert log[heading.split(" [")[0]][1] == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ["empty file"]),
        ("\n\n", ["empty file"]),
        (HEADING + "\n", ["no rows"]),
        (GOOD.replace("tension_AF [N]", "tension_AF [lbf]"), ["tension_AF", "[lbf]"]),
        (GOOD.replace("tension_AF [N]", "tension_AF [m]"), ["tension_AF", "[m]", "[N]"]),
        (GOOD.replace("tension_AF [N]", "tension_AF"), ["tension_AF", "unit"]),
        (GOOD.replace("tension_AF [N]", "tension_MF [N]"), ["'tension_ref_MF'", "missing"]),
        (GOOD.replace("stroke_AF [m]", "tension_AF [mN]"), ["tension_AF", "twice"]),
        (GOOD.replace("time [s]", "zeit [s]"), ["'time [s]'", "missing"]),
        (GOOD.replace("1.25", "oops"), ["'tension_AF [N]'", "row 3", "'oops'"]),
        (GOOD.replace("1.25", "1_2"), ["row 3"]),
        (GOOD.replace("1.25", "inf"), ["tension_AF", "row 3", "infinite"]),
        (GOOD.replace("\n0.02,", "\n,"), ["'time'", "row 2"]),
        (GOOD.replace("0.04,", "0.01,"), ["'time'", "row 3"]),
        (GOOD.replace("0.04,", "0.02,"), ["'time'", "row 3"]),
        (GOOD.replace(",0.003", ""), ["row 3", "3 cells"]),
        (GOOD.replace(",0.003", ",0.003,7"), ["row 3", "5 cells"]),
        (GOOD.replace(",1.5,", ",,").replace("1.25", ""), ["tension_AF", "empty"]),
        (GOOD.replace(",", ";"), ['separator: ";"']),
        (GOOD.replace(",", "\t"), ['separator: "\\t"']),
        (GOOD.encode("utf-16"), ["not a text file"]),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, parts):
    message = refusal(save(tmp_path, text))
    for part in parts:
        assert part in message


def test_missing_samples_only_where_allowed(tmp_path):
    path = save(tmp_path, GOOD)
    assert np.isnan(read_log(path)["tension_AF"][1])
    assert "row 2" in refusal(path, complete=("tension",))
    assert "angle_MCP" in refusal(path, required=("angle_MCP",))


def test_no_such_file_folder_or_ending(tmp_path):
    assert "no such file" in refusal(tmp_path / "none.csv")
    assert "no such file" in refusal(tmp_path / "none")
    (tmp_path / "folder.csv").mkdir()
    assert "a folder" in refusal(tmp_path / "folder.csv")
    assert "ending" in refusal(save(tmp_path, GOOD, "log.xlsx"))


def test_windows_files_and_quotes(tmp_path):
    text = "\ufeff" + GOOD.replace("\n", "\r\n").replace("tension_AF [N]", '"tension_AF [N]"') + "\r\n"
    assert read_log(save(tmp_path, text)).equals(read_log(save(tmp_path, GOOD, "b.csv")))


def test_a_failed_write_leaves_the_old_file(log, tmp_path, monkeypatch):
    path = save(tmp_path, GOOD)
    with pytest.raises(InputError, match="infinite;"):
        write_log(log.with_signals({"angle_MCP": np.full(50, np.inf)}), path)
    monkeypatch.setattr("os.replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(InputError, match="No space left"):
        write_log(log, path)
    assert path.read_text() == GOOD and list(tmp_path.iterdir()) == [path]
    with pytest.raises(InputError, match="nowhere"):
        write_log(log, tmp_path / "nowhere" / "log.csv")


def test_a_regular_log_is_left_as_it_is():
    log = Log(np.round(0.02 * np.arange(3000), 2), {"tension_AF": np.ones(3000)})
    assert regularise(log) == (log, [])


def test_repeated_rows_go_and_missing_frames_are_left_empty():
    log = Log(0.02 * np.arange(100), {"tension_AF": np.arange(100.0)})
    kept = np.sort(np.concatenate([np.delete(np.arange(100), [10, 11, 50]), [3, 3, 70]]))
    mended, notes = regularise(log.rows(kept))
    np.testing.assert_array_equal(mended.time, log.time)
    assert list(np.flatnonzero(np.isnan(mended["tension_AF"]))) == [10, 11, 50]
    assert len(notes) == 2 and "3 repeated rows" in notes[0] and "3 missing frames" in notes[1]
    assert regularise(mended) == (mended, [])


@pytest.mark.parametrize(
    ("times", "part"),
    [
        ([0, 0.02, 0.04, 0.02, 0.06], "row 4"),
        ([0, 0.02, 0.02, 0.04], "row 3"),
        ([0, 0.005, 0.01, 0.015], "apart"),
        ([0, 0.02, 1e9], "gap"),
    ],
)
def test_clock_faults_are_refused_by_name(times, part):
    with pytest.raises(InputError, match=part):
        regularise(Log(np.array(times), {"tension_AF": np.arange(float(len(times)))}, source="drive.csv"))


@pytest.mark.parametrize(("unit", "name", "a_second"), [("ms", "milliseconds", 1e3), ("us", "microseconds", 1e6)])
@pytest.mark.parametrize("rows", [3, 500])
def test_a_clock_in_another_unit_is_named_and_read_with_its_unit(tmp_path, unit, name, a_second, rows):
    """Frames of 20 ms that err by 1 ms (RMS), and 37 of which are missing, headed as seconds and as what they are."""
    draw = np.random.default_rng(5)
    times = 0.02 * np.delete(np.arange(rows + 37), np.arange(2, 39)) + 1e-3 * draw.standard_normal(rows)
    text = "".join(f"{a_second * time:.0f},{n}\n" for n, time in enumerate(times))
    with pytest.raises(InputError, match=rf"log\.csv: column 'time' looks like {name}.*'time \[{unit}\]'"):
        regularise(read_log(save(tmp_path, f"time [s],force_x [N]\n{text}")))
    mended, _ = regularise(read_log(save(tmp_path, f"time [{unit}],force_x [N]\n{text}")))
    assert len(mended) == rows + 37


SI = sorted({read_unit(unit).si for unit in (*UNITS, *COMMON)})
TENDONS = st.sampled_from(["AF", "MF", "ref_AF", "a_b", "0", "MCP", ""])
COLUMN = st.one_of(
    st.builds(lambda kind, wire: f"{kind}_{wire}".rstrip("_"), st.sampled_from(sorted(set(KINDS) - {"time"})), TENDONS),
    st.text(min_size=1, max_size=8),  # brackets, commas, quotes, line breaks, letters of any script
)
SAMPLE = st.one_of(
    st.floats(allow_infinity=False), st.sampled_from([-0.0, 0.1 + 0.2, 5e-324, 1.7976931348623157e308, np.nan])
)


@st.composite
def logs(draw) -> Log:
    """Up to six rows and four columns in any SI unit that suits the column."""
    rows = draw(st.integers(1, 6))
    start = draw(st.floats(-1e6, 1e9))
    steps = draw(st.lists(st.floats(1e-6, 1e3), min_size=rows - 1, max_size=rows - 1))
    signals, units = {}, {}
    for name in draw(st.lists(COLUMN, max_size=4, unique=True)):
        signals[name] = np.array(draw(st.lists(SAMPLE, min_size=rows, max_size=rows)))
        kind = next((k for k in sorted(KINDS, key=len, reverse=True) if name == k or name.startswith(k + "_")), None)
        units[name] = draw(st.sampled_from(KINDS[kind] if kind else SI))
    return Log(np.cumsum([start, *steps]), signals, units)


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    """Equal with the sign of zero; any NaN is NaN."""
    return np.array_equal(a, b, equal_nan=True) and np.array_equal(np.signbit(a[a == 0]), np.signbit(b[b == 0]))


@pytest.mark.parametrize("ending", formats())
@settings(max_examples=80, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(log=logs())
@example(log=Log(np.array([0.0, 3e10]), {"tension_AF": np.array([1.0, 2.0])}))  # beyond MCAP's nanoseconds
def test_back_to_the_last_digit_or_refused(tmp_path, ending, log):
    path = tmp_path / f"log{ending}"
    path.unlink(missing_ok=True)
    try:
        write_log(log, path)
    except InputError as error:
        assert "log" in str(error) and not list(tmp_path.iterdir())
        return
    back = read_log(path)
    assert back.columns == log.columns and back.units == log.units
    assert same_bits(back.time, log.time)
    assert all(same_bits(back[name], log[name]) for name in log.columns)


@pytest.mark.parametrize("ending", formats())
def test_ordinary_names_are_never_refused(tmp_path, ending):
    """The property above would hold for a writer that refuses all."""
    names = [f"{kind}_{wire}" for kind in sorted(set(KINDS) - {"time"}) for wire in ("AF", "index_PIP", "7")]
    draw = np.random.default_rng(4)
    log = Log(0.02 * np.arange(30), {name: draw.normal(size=30) * 10.0 ** draw.integers(-9, 9) for name in names})
    write_log(log, tmp_path / f"log{ending}")
    assert read_log(tmp_path / f"log{ending}").equals(log)


TIME = 0.02 * np.arange(100)


def line(shift=0.0, source="a", time=TIME, **more) -> exo.Log:
    """A line of slope 3 N/s, and an angle that stands."""
    return exo.Log(
        time, {"tension_AF": 3.0 * time + shift, "angle_MCP": np.full(len(time), 0.1), **more}, source=source
    )


def test_a_constant_shift_is_its_own_rms_mean_and_largest_difference():
    found = compare(line(), line(0.5)).signals["tension_AF"]
    assert (found.rms, found.mean, found.largest, found.unit, found.samples) == (0.5, 0.5, pytest.approx(0.5), "N", 100)
    assert compare(line(), line()).signals["angle_MCP"].rms == 0.0


def test_another_clock_is_read_between_its_samples_where_both_have_any():
    found = compare(line(), line(time=0.5 + 0.03 * np.arange(40)))
    assert (found.start, found.end) == (0.5, pytest.approx(1.67)) and "both cover" in found.notes[-1]
    assert found.signals["tension_AF"].largest == pytest.approx(0.0, abs=1e-12)


def test_missing_samples_and_lone_columns_are_left_out_and_said():
    holes = line(0.5)["tension_AF"].copy()
    holes[10:] = np.nan
    found = compare(line(angle_PIP=np.ones(100)), line(tension_AF=holes, source="b"))
    assert found.signals["tension_AF"].samples == 10 and found.notes == ("angle_PIP only in a",)


@pytest.mark.parametrize("other", [line(time=TIME + 9.0), exo.Log(TIME, {"stroke_AF": TIME})])
def test_logs_without_anything_in_common_are_refused(other):
    with pytest.raises(exo.InputError, match="in common"):
        compare(line(), other)


def test_the_command_prints_units_and_writes_figure_and_numbers(tmp_path):
    exo.write_log(line(), tmp_path / "a.csv")
    exo.write_log(line(0.5, angle_PIP=TIME), tmp_path / "b.csv")
    figure, numbers = tmp_path / "c.png", tmp_path / "c.json"
    result = run("compare", tmp_path / "a.csv", tmp_path / "b.csv", "--out", figure, "--json", numbers)
    assert result.exit_code == 0 and "angle_PIP only in" in result.output
    (row,) = (line.split() for line in result.output.splitlines() if line.startswith("tension AF"))
    assert row[2:5] == ["N", "0.5", "0.5"]
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert json.loads(numbers.read_text())["signals"]["tension_AF"]["rms"] == pytest.approx(0.5)
    assert run("compare", tmp_path / "a.csv", tmp_path / "none.csv").exit_code == 2
    assert run("compare", tmp_path / "a.csv", tmp_path / "b.csv", "--out", tmp_path / "c.svg").exit_code == 2


def lines(figure, axes=0):
    """Whether the courses in one of the panels are solid, in order."""
    return [line.get_linestyle() == "-" for line in figure.axes[axes].lines]


def test_the_nominal_robot_is_dotted_on_either_side_and_differences_stand_below():
    measured, nominal = line(), replace(line(0.5), simulated=MODEL)
    assert lines(measured.plot("", nominal, ("robot", "model"))) == [True, False]
    figure = nominal.plot("model and robot", measured, ("model", "robot"), difference=True)
    assert lines(figure) == [False, True] and len(figure.axes) == 4
    np.testing.assert_allclose(figure.axes[1].lines[0].get_ydata(), -0.5)  # second less first, below the tension
    assert figure.axes[-1].get_xlabel() == "Time [s]" and figure.texts[0].get_text() == "model and robot"


def test_a_log_in_a_notebook_is_a_headline_a_table_and_a_small_figure():
    page = line(source="<b>.csv", **{f"force_{k}": TIME for k in range(40)})._repr_html_()
    assert page.startswith("<b>&lt;b&gt;.csv</b>: 100 rows, 0 to 1.98 s") and "and 12 more" in page
    assert "<td>tension_AF</td><td>N</td><td>100</td><td>0</td><td>5.94</td>" in page
    assert len(page) < 150_000 and "base64," in page and "<img" not in line(time=TIME[:0])._repr_html_()
