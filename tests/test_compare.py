"""Two logs beside each other: differences of known logs, and `exodrake compare`."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import run

import exodrake as exo
from exodrake.data.log import MODEL, compare

TIME = 0.02 * np.arange(100)


def log(shift=0.0, source="a", time=TIME, **more) -> exo.Log:
    """A line of slope 3 N/s, and an angle that stands."""
    return exo.Log(
        time, {"tension_AF": 3.0 * time + shift, "angle_MCP": np.full(len(time), 0.1), **more}, source=source
    )


def test_a_constant_shift_is_its_own_rms_mean_and_largest_difference():
    found = compare(log(), log(0.5)).signals["tension_AF"]
    assert (found.rms, found.mean, found.largest, found.unit, found.samples) == (0.5, 0.5, pytest.approx(0.5), "N", 100)
    assert compare(log(), log()).signals["angle_MCP"].rms == 0.0


def test_another_clock_is_read_between_its_samples_where_both_have_any():
    found = compare(log(), log(time=0.5 + 0.03 * np.arange(40)))
    assert (found.start, found.end) == (0.5, pytest.approx(1.67)) and "both cover" in found.notes[-1]
    assert found.signals["tension_AF"].largest == pytest.approx(0.0, abs=1e-12)


def test_missing_samples_and_lone_columns_are_left_out_and_said():
    holes = log(0.5)["tension_AF"].copy()
    holes[10:] = np.nan
    found = compare(log(angle_PIP=np.ones(100)), log(tension_AF=holes, source="b"))
    assert found.signals["tension_AF"].samples == 10 and found.notes == ("angle_PIP only in a",)


@pytest.mark.parametrize("other", [log(time=TIME + 9.0), exo.Log(TIME, {"stroke_AF": TIME})])
def test_logs_without_anything_in_common_are_refused(other):
    with pytest.raises(exo.InputError, match="in common"):
        compare(log(), other)


def test_the_command_prints_units_and_writes_figure_and_numbers(tmp_path):
    exo.write_log(log(), tmp_path / "a.csv")
    exo.write_log(log(0.5, angle_PIP=TIME), tmp_path / "b.csv")
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
    measured, nominal = log(), replace(log(0.5), simulated=MODEL)
    assert lines(measured.plot("", nominal, ("robot", "model"))) == [True, False]
    figure = nominal.plot("model and robot", measured, ("model", "robot"), difference=True)
    assert lines(figure) == [False, True] and len(figure.axes) == 4
    np.testing.assert_allclose(figure.axes[1].lines[0].get_ydata(), -0.5)  # second less first, below the tension
    assert figure.axes[-1].get_xlabel() == "Time [s]" and figure.texts[0].get_text() == "model and robot"


def test_a_log_in_a_notebook_is_a_headline_a_table_and_a_small_figure():
    page = log(source="<b>.csv", **{f"force_{k}": TIME for k in range(40)})._repr_html_()
    assert page.startswith("<b>&lt;b&gt;.csv</b>: 100 rows, 0 to 1.98 s") and "and 12 more" in page
    assert "<td>tension_AF</td><td>N</td><td>100</td><td>0</td><td>5.94</td>" in page
    assert len(page) < 150_000 and "base64," in page and "<img" not in log(time=TIME[:0])._repr_html_()
