"""Marker files and the command line: what is read back, what is refused, and that nothing is left half-written."""

import numpy as np
import pytest
from click.testing import CliRunner

from exodrake.cli.main import cli
from exodrake.core.errors import InputError
from exodrake.identification.kinematics.identify import identify
from exodrake.identification.kinematics.markers import (
    Faults,
    Hand,
    Layout,
    Recording,
    Swap,
    c3d_bytes,
    check_labels,
    csv_bytes,
    exchange_labels,
    parse_csv,
    read_layout,
    read_markers,
    synthesise,
)


def _recording(**faults) -> Recording:
    return synthesise(Hand(), Faults(**faults), 8.0, 50.0, 3)[0]


def _swapped(swap: Swap) -> Recording:
    recording, span = _recording(noise=1e-4), slice(swap.first, swap.last + 1)
    a, b = (recording.names.index(name) for name in swap.names)
    recording.positions[span, [a, b]] = recording.positions[span, [b, a]]
    return recording


@pytest.mark.parametrize("ending", ["csv", "c3d"])
def test_marker_files_read_back(tmp_path, ending):
    recording = _recording(noise=3e-4, dropouts=20)
    assert np.isnan(recording.positions).any()
    (tmp_path / f"hand.{ending}").write_bytes(csv_bytes(recording) if ending == "csv" else c3d_bytes(recording))
    back = read_markers(tmp_path / f"hand.{ending}")
    assert back.names == recording.names
    np.testing.assert_allclose(back.positions, recording.positions, atol=1e-15 if ending == "csv" else 1e-6)
    np.testing.assert_allclose(back.time, recording.time, atol=0.0 if ending == "csv" else 1e-6)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time [s],B1_x [mm]\n0,1\n", "B1 lacks its y, z column"),
        ("time [s],B1_x,B1_y [mm],B1_z [mm]\n0,1,1,1\n", "'B1_x': wanted a name and a unit in brackets"),
        (
            "time [s],B1_x [kg],B1_y [mm],B1_z [mm]\n0,1,1,1\n",
            "column 'B1_x' is in [kg], which does not convert to [m]",
        ),
        ("B1_x [mm],B1_y [mm],B1_z [mm]\n1,1,1\n", "no column 'time [s]'"),
        ("time [s],other\n0,1\n", "no marker columns"),
        ("time [s],B1_x [mm],B1_y [mm],B1_z [mm]\n0,1,1,1\n0,1,1,1\n", "time does not rise at frame 1"),
        ("time [s],B1_x [mm],B1_y [mm],B1_z [mm]\n0,1,1,inf\n", "column 'B1_z', row 1: infinite"),
        ("# nothing\n", "empty"),
    ],
)
def test_bad_csv_is_refused_by_name(text, message):
    with pytest.raises(InputError, match=r"hand\.csv") as refused:
        parse_csv(text.encode(), "hand.csv")
    assert message in str(refused.value)
    back = parse_csv(b"time [ms],A_x [cm],A_y [mm],A_z [m]\n0,1,1,1\n10,1,1,1\n", "x")
    assert back.time.tolist() == [0.0, 0.01] and back.positions[0, 0].tolist() == [0.01, 0.001, 1.0]


@pytest.mark.parametrize("pair", [("P1", "P3"), ("P2", "M1"), ("D1", "D2"), ("B1", "D3")])
def test_swapped_markers_are_named_with_their_frames_and_can_be_repaired(pair):
    swap = Swap(pair, 200, 230)
    recording = _swapped(swap)
    with pytest.raises(InputError, match=rf"{pair[0]} and {pair[1]} are swapped from frame 200 .* to 230"):
        identify(recording)
    check = check_labels(recording, Layout())
    assert check.swaps == (swap,)
    np.testing.assert_array_equal(exchange_labels(recording, check.swaps).positions, _recording(noise=1e-4).positions)


@pytest.mark.parametrize("pair", [("P3", "M1"), ("P2", "M1"), ("M2", "D1"), ("B1", "P1")])
def test_labels_swapped_all_along_are_named(pair):
    recording = _swapped(Swap(pair, 0, 399))
    with pytest.raises(InputError, match=f"with {pair[0]} and {pair[1]} exchanged they do not"):
        identify(recording)


def test_noise_alone_is_never_taken_for_a_swap():
    recording = synthesise(Hand(), Faults(noise=5e-4), 60.0, 100.0, 9)[0]
    assert check_labels(recording, Layout()).swaps == ()


def test_collinear_triad_is_named():
    recording = _recording()
    first, second, third = (recording.names.index(name) for name in ("D1", "D2", "D3"))
    recording.positions[:, third] = 0.3 * recording.positions[:, first] + 0.7 * recording.positions[:, second]
    with pytest.raises(InputError, match="D1, D2, D3 lie on a line"):
        identify(recording)


def test_absent_markers_and_impossible_recordings_are_named():
    recording = _recording()
    keep = [k for k, name in enumerate(recording.names) if name != "M2"]
    short = Recording(tuple(recording.names[k] for k in keep), recording.time, recording.positions[:, keep], "hand.csv")
    with pytest.raises(InputError, match=r"hand\.csv: no marker M2"):
        identify(short)
    recording.positions[20:, recording.names.index("P3")] = np.nan
    with pytest.raises(InputError, match=r"P3 being missing in 9\d %"):
        identify(recording, cutoff=None)
    for faults, duration, word in (({"noise": -1.0}, 8.0, "noise"), ({}, np.inf, "3 to 3600 s")):
        with pytest.raises(InputError, match=word):
            synthesise(Hand(), Faults(**faults), duration, 50.0, 3)


def test_too_few_frames_still_joints_and_restless_starts_are_refused():
    recording = _recording()
    few = Recording(recording.names, recording.time[:40], recording.positions[:40], "hand.csv")
    with pytest.raises(InputError, match="MCP is seen in 40 of 40 frames"):
        identify(few, cutoff=None)
    stiff = synthesise(Hand(flexion=((-0.35, 1.34), (0.0, 0.1), (0.07, 0.92))), Faults(), 8.0, 50.0, 3)[0]
    with pytest.raises(InputError, match=r"PIP turns 5\.7 deg at most"):
        identify(stiff, cutoff=None)
    late = Recording(recording.names, recording.time[80:], recording.positions[80:], "hand.csv")
    with pytest.raises(InputError, match="straight and still"):
        identify(late, cutoff=None)


def test_layout_file(tmp_path):
    path = tmp_path / "names.yaml"
    path.write_text("proximal: [a, b, c]\n")
    assert read_layout(path).proximal == ("a", "b", "c")
    for text, message in (
        ("proximal: [a, b]", "three"),
        ("wrist: [a, b, c]", "wrist"),
        ("middle: [B1, b, c]", "twice"),
        ("tip: P1", "tip P1"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            read_layout(path)


def test_command_writes_table_robot_and_figure(tmp_path):
    from exodrake.machines.robot_file import load_robot

    run = CliRunner().invoke
    made = run(
        cli,
        ["identify", "synthesise", str(tmp_path / "h.c3d"), "--duration", "12", "--rate", "50", "--swap", "P1", "P3"],
    )
    assert made.exit_code == 0, made.output
    out = tmp_path / "out"
    refused = run(cli, ["identify", "kinematics", str(tmp_path / "h.c3d"), "--out", str(out)])
    assert refused.exit_code == 2 and "P1 and P3 are swapped" in refused.output and not out.exists()
    done = run(cli, ["identify", "kinematics", str(tmp_path / "h.c3d"), "--out", str(out), "--repair"])
    assert done.exit_code == 0, done.output
    assert {file.name for file in out.iterdir()} == {"kinematics.csv", "kinematics.md", "kinematics.png", "robot.yaml"}
    assert load_robot(out / "robot.yaml")["finger.length.MCP"] == pytest.approx(0.04264, abs=1e-3)
    missing = run(cli, ["identify", "kinematics", str(tmp_path / "none.csv")])
    assert missing.exit_code == 2 and "none.csv" in missing.output
