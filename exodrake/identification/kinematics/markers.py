"""Marker recordings, their CSV and C3D files, and which marker is on which segment (paper Fig. 8-9).

Lines of CSV that begin with # are comments, followed by one heading and one row per frame:

    time [s], B1_x [mm], B1_y [mm], B1_z [mm], B2_x [mm], ...

Every column carries its unit in brackets (m, cm or mm; s or ms); a marker has three columns, in any order; an empty
cell is a missing sample. Other columns are ignored. Positions are in the right-handed laboratory frame of the cameras.

C3D, the exchange format of motion capture, is read and written by ezc3d. Labels may carry a subject (`Kim:B1` is read
as B1), POINT:UNITS gives the unit, POINT:RATE the frame rate; a point with a negative residual is missing.

The controller's clock on the clock of the motion capture follows from the record of the sync pulse (Fig. 5 and 8a):

    start, skew = clock_from_pulses(time, level, robot.machine.frame)
    controller_time = (capture_time - start) / (1.0 + skew)
"""

from __future__ import annotations

import os
import re
import struct
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes
from exodrake.core.processes import in_child
from exodrake.core.schema import listing, mapping, optional, read_yaml, text
from exodrake.core.units import si_unit, to_si

SEGMENTS = ("base", "proximal", "middle", "distal")
JOINTS = ("MCP", "PIP", "DIP")


def marker(value: Any, where: str) -> str:
    """A marker's name; systems that number their markers give numbers."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else text()(value, where)


TRIAD = listing(marker, length=3, wanted="three marker names")
THUMB = optional(listing(marker, wanted="a list of marker names"))
SCHEMA = mapping({**dict.fromkeys(SEGMENTS, TRIAD), "thumb": THUMB, "tip": marker})


@dataclass(frozen=True)
class Layout:
    """Marker names per segment, from the hand to the fingertip; `tip` is the distal marker at the fingertip."""

    base: tuple[str, str, str] = ("B1", "B2", "B3")
    proximal: tuple[str, str, str] = ("P1", "P2", "P3")
    middle: tuple[str, str, str] = ("M1", "M2", "M3")
    distal: tuple[str, str, str] = ("D1", "D2", "D3")
    thumb: tuple[str, ...] = ("T1", "T2")
    tip: str = "D2"

    @property
    def segments(self) -> tuple[tuple[str, str, str], ...]:
        """The four triads, in the order of SEGMENTS."""
        return self.base, self.proximal, self.middle, self.distal

    @property
    def finger(self) -> tuple[str, ...]:
        """The twelve markers of the identification, without those of the thumb."""
        return tuple(name for triad in self.segments for name in triad)


def read_layout(path: str | Path) -> Layout:
    """Read a layout from YAML such as `proximal: [RP1, RP2, RP3]`; absent keys keep their defaults.

    Raises:
        InputError: Naming file and key, for an unknown key, not three names in a triad, or a marker named twice.
    """
    content: dict[str, Any] = SCHEMA(read_yaml(path), str(path))
    names: dict[str, Any] = {key: v if key == "tip" else tuple(v or ()) for key, v in content.items()}
    layout = Layout(**names)
    twice = {name for name in layout.finger if layout.finger.count(name) > 1}
    if twice:
        raise InputError(f"{path}: marker {', '.join(sorted(twice))} is named twice")
    if layout.tip not in layout.distal:
        raise InputError(f"{path}: tip {layout.tip} is not one of the distal markers {', '.join(layout.distal)}")
    return layout


HEADING = re.compile(r"^(?P<marker>.+)_(?P<axis>[xyz])\s*\[(?P<unit>[^\]]*)\]$")
TIME = re.compile(r"^time\s*\[(?P<unit>[^\]]*)\]$")


@dataclass(frozen=True)
class Recording:
    """Marker recording.

    Attributes:
        names: Names of the markers.
        time: (frames,) [s].
        positions: (frames, markers, 3) [m], NaN where missing.
        source: Name of the file.
    """

    names: tuple[str, ...]
    time: np.ndarray
    positions: np.ndarray
    source: str = "recording"

    def of(self, names: tuple[str, ...]) -> np.ndarray:
        """Positions (frames, len(names), 3) [m] of some markers. InputError naming those that are missing."""
        lost = [name for name in names if name not in self.names]
        if lost:
            have = ", ".join(self.names) or "none"
            raise InputError(f"{self.source}: no marker {', '.join(lost)} (the recording has {have})")
        return self.positions[:, [self.names.index(name) for name in names]]


def parse_csv(data: bytes, source: str) -> Recording:
    """Parse a CSV file. InputError for a missing heading, unit or axis, or for time that does not rise."""
    from exodrake.data.formats.csv import read_cells

    lines = data.splitlines(keepends=True)
    headings, values = read_cells(b"".join(line for line in lines if not line.lstrip().startswith(b"#")), source)
    time, columns = None, {}
    for heading, column in zip(headings, values.T):
        if found := TIME.match(heading):
            if si_unit(found["unit"], f"{source}, time") != "s":
                raise InputError(f"{source}: time is in [{found['unit']}], wanted [s] or [ms]")
            time = to_si(column, found["unit"]) if time is None else time
        elif found := HEADING.match(heading):
            if si_unit(found["unit"], f"{source}, column {heading!r}") != "m":
                raise InputError(f"{source}: column {heading!r} is not a length")
            axes = columns.setdefault(found["marker"], {})
            if found["axis"] in axes:
                raise InputError(f"{source}: column {heading!r} occurs twice")
            axes[found["axis"]] = to_si(column, found["unit"])
        elif re.search(r"_[xyz]$", heading):
            raise InputError(f"{source}: column {heading!r} has no unit, wanted '{heading} [mm]'")
    for name, axes in columns.items():
        if lost := [axis for axis in "xyz" if axis not in axes]:
            raise InputError(f"{source}: marker {name} lacks its {', '.join(lost)} column")
    if not columns:
        raise InputError(f"{source}: no marker columns such as 'B1_x [mm]'")
    if time is None:
        raise InputError(f"{source}: no column 'time [s]'")
    places = [np.stack([axes[axis] for axis in "xyz"], axis=1) for axes in columns.values()]
    return check_recording(Recording(tuple(columns), time, np.stack(places, axis=1), source))


def check_recording(recording: Recording) -> Recording:
    """Check that time rises and positions are finite, else InputError; a marker seen in part becomes missing."""
    wrong = np.flatnonzero(~np.isfinite(recording.time))
    if not len(wrong):
        wrong = 1 + np.flatnonzero(np.diff(recording.time) <= 0)
    if len(wrong):
        raise InputError(f"{recording.source}: time does not rise at frame {wrong[0]}")
    if np.isinf(recording.positions).any():
        frame, marker, _ = np.argwhere(np.isinf(recording.positions))[0]
        raise InputError(f"{recording.source}: marker {recording.names[marker]} is infinite in frame {frame}")
    seen = np.isfinite(recording.positions).all(axis=2, keepdims=True)
    return replace(recording, positions=np.where(seen, recording.positions, np.nan))


FORMAT = (
    "One row per frame. Units in brackets. An empty cell is a sample the cameras missed.",
    "Places in the laboratory frame, right-handed. B1-B3 back of the hand; P1-P3 proximal, M1-M3 middle, D1-D3 distal",
    "phalanx; T1 T2 thumb. D2 sits at the fingertip.",
    "The recording begins with the finger straight and still (1 s); all angles and lengths refer to that posture.",
)


def csv_bytes(recording: Recording, remarks: tuple[str, ...] = ()) -> bytes:
    """Encode a recording as CSV in mm with comment lines, in the shortest digits that read back exactly."""
    columns = [f"{name}_{axis} [mm]" for name in recording.names for axis in "xyz"]
    table = np.column_stack([recording.time, 1e3 * recording.positions.reshape(len(recording.time), -1)])
    rows = [",".join("" if cell != cell else repr(cell) for cell in row) for row in table.tolist()]
    comments = [f"# {remark}" for remark in (*remarks, *FORMAT)]
    return ("\n".join([*comments, ",".join(["time [s]", *columns]), *rows]) + "\n").encode()


BIG_ENDIAN = 86  # number of the processor that wrote the file: MIPS
BLOCK = 512  # bytes


def count_frames(data: bytes) -> int:
    """Number of frames that the header promises; the format counts to 65535. 0 of a file too short for a header."""
    mark = BLOCK * (data[0] - 1) + 3 if data else 0
    if mark < 0 or len(data) <= max(mark, BLOCK):
        return 0
    first, last = struct.unpack_from(">HH" if data[mark] == BIG_ENDIAN else "<HH", data, 6)
    return last - first + 1


def parse_c3d(path: str, frames: int) -> Recording:
    """`read_c3d` in this process; frames: how many there have to be at least."""
    import ezc3d

    try:
        content = ezc3d.c3d(path)
    except Exception as error:  # ezc3d raises bare C++ exceptions of several kinds
        raise InputError(f"{path}: not a C3D file ({error})") from None
    settings = content["parameters"]["POINT"]
    names = tuple(label.rsplit(":", 1)[-1].strip() for label in settings["LABELS"]["value"])
    points = np.moveaxis(content["data"]["points"][:3], 0, 2).swapaxes(0, 1)
    rate = float(next(iter(np.ravel(settings["RATE"]["value"])), 0.0))
    if len(points) < frames:
        raise InputError(f"{path}: {len(points)} frames, but its header promises {frames}: it is cut short")
    if not names or len(points) == 0 or rate <= 0:
        raise InputError(f"{path}: no points, or no frame rate")
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{path}: two points are called {twice}")
    unit = (list(settings["UNITS"]["value"]) or [""])[0]
    if si_unit(unit, f"{path}, POINT:UNITS") != "m":
        raise InputError(f"{path}: POINT:UNITS is [{unit}], not a length")
    residuals = content["data"]["meta_points"]["residuals"]  # ezc3d gives NaN for most negative ones
    if residuals.shape[1:] == points.shape[1::-1]:
        points = np.where((residuals[0].T < 0)[:, :, None], np.nan, points)
    return check_recording(
        Recording(names, np.arange(len(points)) / rate, to_si(points[:, : len(names)], unit), str(path))
    )


def c3d_bytes(recording: Recording) -> bytes:
    """Encode a recording as a C3D file in mm, in the single precision of the format."""
    import ezc3d

    content = ezc3d.c3d()
    frames, count, _ = recording.positions.shape
    points = np.full((4, count, frames), np.nan)
    points[:3] = 1e3 * np.transpose(recording.positions, (2, 1, 0))
    points[3] = 1.0
    content["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    content["parameters"]["POINT"]["RATE"]["value"] = [float(1 / np.median(np.diff(recording.time)))]
    content["parameters"]["POINT"]["LABELS"]["value"] = list(recording.names)
    content["data"]["points"] = points
    with tempfile.TemporaryDirectory() as folder:
        name = Path(folder) / "recording.c3d"
        content.write(str(name))
        return name.read_bytes()


def read_markers(path: str | Path) -> Recording:
    """Read a `.c3d` file, or CSV under any other name. InputError names the file, and column and row if known."""
    if Path(path).suffix.lower() == ".c3d":
        data = read_bytes(path)
        return in_child(parse_c3d, os.fspath(path), count_frames(data), source=str(path), size=len(data))
    return parse_csv(read_bytes(path), str(path))


def clock_from_pulses(time: np.ndarray, level: np.ndarray, frame: float) -> tuple[float, float]:
    """Start and skew of the controller's clock, by least squares over the rising edges.

    Args:
        time: (n,) instants on the clock of the motion capture [s].
        level: (n,) analogue record of the sync pulse, any unit.
        frame: time between pulses on the controller's clock [s].

    Returns:
        The instant of the first pulse recorded [s], and the relative excess of a frame's duration [-]: 1e-4 where the
        capture counts 100 us more in a second than the controller. Missed pulses are bridged.

    Raises:
        InputError: fewer than two pulses rise in the record, or time does not increase.
    """
    if not (np.diff(time) > 0.0).all():
        raise InputError("sync pulse: time does not increase")
    middle = (np.min(level) + np.max(level)) / 2.0
    rises = np.flatnonzero((level[:-1] <= middle) & (level[1:] > middle))
    if len(rises) < 2:
        raise InputError(f"sync pulse: {len(rises)} rising edges, wanted 2 or more")
    share = (middle - level[rises]) / (level[rises + 1] - level[rises])
    edges = time[rises] + share * (time[rises + 1] - time[rises])
    count = np.concatenate([[0], np.cumsum(np.round(np.diff(edges) / frame))])
    slope, start = np.polyfit(count, edges, 1)
    return float(start), float(slope / frame - 1.0)
