"""Marker recording, and its CSV format.

Lines that begin with # are comments, followed by one heading and one row per frame:

    time [s], B1_x [mm], B1_y [mm], B1_z [mm], B2_x [mm], ...

Every column carries its unit in brackets (m, cm or mm; s or ms); a marker has three columns, in any order; an empty
cell is a missing sample. Other columns are ignored. Positions are in the right-handed laboratory frame of the cameras.
"""

import io
import re
from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError

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
    names, places = _places(headings, values, source)
    return checked(Recording(names, _time(headings, values, source), places, source))


def checked(recording: Recording) -> Recording:
    """Check that time rises and positions are finite, else InputError; a marker seen in part becomes missing."""
    steps = np.diff(recording.time)
    if not np.isfinite(recording.time).all() or (steps <= 0).any():
        bad = (
            int(np.argmax(~np.isfinite(recording.time)))
            if not np.isfinite(recording.time).all()
            else int(np.argmax(steps <= 0)) + 1
        )
        raise InputError(f"{recording.source}: time does not rise at frame {bad}")
    if np.isinf(recording.positions).any():
        frame, marker, _ = np.argwhere(np.isinf(recording.positions))[0]
        raise InputError(f"{recording.source}: marker {recording.names[marker]} is infinite in frame {frame}")
    seen = np.isfinite(recording.positions).all(axis=2, keepdims=True)
    return Recording(recording.names, recording.time, np.where(seen, recording.positions, np.nan), recording.source)


def csv_bytes(recording: Recording, remarks: tuple[str, ...] = ()) -> bytes:
    """Encode a recording as CSV in mm with comment lines, in the shortest digits that read back exactly."""
    stream = io.StringIO()
    for remark in (*remarks, *FORMAT):
        stream.write(f"# {remark}\n")
    columns = [f"{name}_{axis} [mm]" for name in recording.names for axis in "xyz"]
    stream.write(",".join(["time [s]", *columns]) + "\n")
    table = np.column_stack([recording.time, 1e3 * recording.positions.reshape(len(recording.time), -1)])
    for row in table.tolist():
        stream.write(",".join("" if cell != cell else repr(cell) for cell in row) + "\n")
    return stream.getvalue().encode()


FORMAT = (
    "One row per frame. Units in brackets. An empty cell is a sample the cameras missed.",
    "Places in the laboratory frame, right-handed. B1-B3 back of the hand; P1-P3 proximal, M1-M3 middle, D1-D3 distal",
    "phalanx; T1 T2 thumb. D2 sits at the fingertip.",
    "The recording begins with the finger straight and still (1 s); all angles and lengths refer to that posture.",
)


def _time(headings: list[str], values: np.ndarray, source: str) -> np.ndarray:
    from exodrake.core.units import si_unit, to_si

    for number, heading in enumerate(headings):
        found = TIME.match(heading)
        if found:
            if si_unit(found["unit"], f"{source}, time") != "s":
                raise InputError(f"{source}: time is in [{found['unit']}], wanted [s] or [ms]")
            return to_si(values[:, number], found["unit"])
    raise InputError(f"{source}: no column 'time [s]'")


def _places(headings: list[str], values: np.ndarray, source: str) -> tuple[tuple[str, ...], np.ndarray]:
    from exodrake.core.units import si_unit, to_si

    columns: dict[str, dict[str, np.ndarray]] = {}
    for number, heading in enumerate(headings):
        found = HEADING.match(heading)
        if not found:
            if re.search(r"_[xyz]$", heading):
                raise InputError(f"{source}: column {heading!r} has no unit, wanted '{heading} [mm]'")
            continue
        if si_unit(found["unit"], f"{source}, column {heading!r}") != "m":
            raise InputError(f"{source}: column {heading!r} is not a length")
        axes = columns.setdefault(found["marker"], {})
        if found["axis"] in axes:
            raise InputError(f"{source}: column {heading!r} occurs twice")
        axes[found["axis"]] = to_si(values[:, number], found["unit"])
    for marker, axes in columns.items():
        if len(axes) < 3:
            raise InputError(
                f"{source}: marker {marker} lacks its {', '.join(a for a in 'xyz' if a not in axes)} column"
            )
    if not columns:
        raise InputError(f"{source}: no marker columns such as 'B1_x [mm]'")
    stacked = [np.stack([axes[a] for a in "xyz"], axis=1) for axes in columns.values()]
    return tuple(columns), np.stack(stacked, axis=1)
