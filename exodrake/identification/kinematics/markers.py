"""Marker recordings: files, clock, the check of their labels, and synthetic ones with known truth (paper Fig. 5, 8-9).

Files and check are described in `docs/explain/identification.md`. Nothing in a synthetic recording was measured.
"""

import os
import re
import struct
import tempfile
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes
from exodrake.core.processes import in_child
from exodrake.core.schema import listing, mapping, optional, read_yaml, text
from exodrake.data.log import columns_in_si
from exodrake.identification.kinematics import rigid
from exodrake.identification.workspace import LENGTHS, SPONTANEOUS
from exodrake.model.units import read_unit, to_si
from exodrake.simulation.protocols import smooth

SEGMENTS = ("base", "proximal", "middle", "distal")
JOINTS = ("MCP", "PIP", "DIP")
BIG_ENDIAN = 86  # number of the processor that wrote a C3D file: MIPS
BLOCK = 512  # bytes
FLATTEST = 2e-3  # m; a lower triangle does not determine the rotation about its long side
PAIRS = np.array(list(combinations(range(12), 2)))  # of markers that may carry each other's name
EXCHANGED = np.tile(np.arange(12), (len(PAIRS), 1))  # (pairs, 12) the markers, those of a pair exchanged
np.put_along_axis(EXCHANGED, PAIRS, PAIRS[:, ::-1], axis=1)
OUTLIER = 4.0  # times the median residual
EXACT = 3e-4  # m; residual below which no frame is suspected, however small the median
SUSPECT = 1.2e-3  # m; a triad that changes its shape by this much in a tenth of the frames may hold a wrong marker
LOOSE = 4e-3  # m; one that changes it by this much is no rigid body
MM = 1e-3
PLACES = {  # of synthetic markers, mm from the joint before the segment, at rest
    "base": ((-20, 14, 12), (-58, 16, -2), (-26, 18, -18)),
    "proximal": ((10, 11, 5), (32, 10, 0), (14, 16, -6)),
    "middle": ((4, 9, 5), (17, 8, -1), (3, 17, -2)),
    "distal": ((4, 7, 5), (18.72, 6, 0), (3, 15, -2)),
    "thumb": ((5, -40, 30), (22, -48, 20)),
}


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


HEADING = re.compile(r"(time|.+_[xyz])\s*(\[.*\])?$")  # of columns that are read


@dataclass(frozen=True)
class Recording:
    """Positions of markers (frames, markers, 3) [m] over time (frames,) [s], NaN where missing, of a file `source`."""

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
    from exodrake.data.formats.csv import read_text

    lines = data.splitlines(keepends=True)
    table = read_text(b"".join(line for line in lines if not line.lstrip().startswith(b"#")), source)
    used = [(heading, column) for heading, column in table.items() if HEADING.match(heading)]
    columns, units = columns_in_si(used, source)
    for column, unit in units.items():
        if unit != (wanted := "s" if column == "time" else "m"):
            raise InputError(f"{source}: column {column!r} is in [{unit}], which does not convert to [{wanted}]")
    if "time" not in columns:
        raise InputError(f"{source}: no column 'time [s]'")
    names = tuple(dict.fromkeys(column[:-2] for column in columns if column != "time"))
    if not names:
        raise InputError(f"{source}: no marker columns such as 'B1_x [mm]'")
    for name in names:
        if lost := [axis for axis in "xyz" if f"{name}_{axis}" not in columns]:
            raise InputError(f"{source}: marker {name} lacks its {', '.join(lost)} column")
    positions = np.transpose([[columns[f"{name}_{axis}"] for axis in "xyz"] for name in names], (2, 0, 1))
    return check_recording(Recording(names, columns["time"], positions, source))


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


def parse_c3d(path: str, frames: int) -> Recording:
    """A C3D file in this process, of a number of frames at least."""
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
    if read_unit(unit, f"{path}, POINT:UNITS").si != "m":
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
    data = read_bytes(path)
    if Path(path).suffix.lower() != ".c3d":
        return parse_csv(data, str(path))
    mark, promised = BLOCK * (data[0] - 1) + 3 if data else -1, 0
    if mark >= 0 and len(data) > max(mark, BLOCK):  # the header promises a number of frames, 65535 at most
        first, last = struct.unpack_from(">HH" if data[mark] == BIG_ENDIAN else "<HH", data, 6)
        promised = last - first + 1
    return in_child(parse_c3d, os.fspath(path), promised, source=str(path), size=len(data))


def clock_from_pulses(time: np.ndarray, level: np.ndarray, frame: float) -> tuple[float, float]:
    """Start and skew of the controller's clock, by least squares over the rising edges; missed pulses are bridged.

    From the analogue record of the sync pulse (n,), any unit, at instants (n,) on the clock of the motion capture [s],
    and the time between pulses on the controller's clock [s]. Start is the instant of the first pulse recorded [s],
    skew the relative excess of a frame's duration [-]: 1e-4 where the capture counts 100 us more in a second than the
    controller.

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


class Swap(NamedTuple):
    """Two markers that carry each other's name from `first` through `last` (frames)."""

    names: tuple[str, str]
    first: int
    last: int


class LabelCheck(NamedTuple):
    """Result of `check_labels`: shapes (4, 3, 3) [m], swaps, unusable frames `spoilt` (4, frames), and remarks."""

    shapes: np.ndarray
    swaps: tuple[Swap, ...]
    spoilt: np.ndarray
    remarks: tuple[str, ...]


def check_labels(recording: Recording, layout: Layout) -> LabelCheck:
    """Compare every frame with the shapes of the triads. InputError for missing markers, collinear or loose triads."""
    points = recording.of(layout.finger)
    shapes = measure_triads(points, layout, recording.source)
    residual = measure_residuals(shapes, points)
    change = np.nanquantile(residual, 0.9, axis=1)
    k = int(np.argmax(change))
    loose = (
        f"{recording.source}: markers {', '.join(layout.segments[k])} ({SEGMENTS[k]}) change their shape, "
        f"by {1e3 * change[k]:.1f} mm or more in a tenth of the frames"
    )
    some = points[:: max(1, len(points) // 200)]
    for (a, b), order in zip(PAIRS, EXCHANGED) if change[k] >= SUSPECT else ():  # names may be wrong throughout
        if a // 3 == b // 3 or k not in (a // 3, b // 3):
            continue
        swapped = some[:, order]
        try:
            residuals = measure_residuals(measure_triads(swapped, layout, "recording"), swapped)
        except InputError:  # collinear
            continue
        if np.nanquantile(residuals, 0.9, axis=1).max() < change[k] / 2:
            a, b = layout.finger[a], layout.finger[b]
            raise InputError(f"{loose}; with {a} and {b} exchanged they do not: look at these labels")
    if change[k] > LOOSE:
        raise InputError(loose)
    limit = np.maximum(OUTLIER * np.nanmedian(residual, axis=1), EXACT)[:, None]
    bad = residual > limit
    # in each suspect frame the pair whose exchange gives the smallest residual, or -1
    suspects, pairs = np.flatnonzero(bad.any(axis=0)), np.full(len(points), -1)
    best = np.full(len(suspects), 1 / 2)  # of the limit
    for number, (a, b) in enumerate(PAIRS if len(suspects) else ()):
        touched = bad[a // 3, suspects] | bad[b // 3, suspects]
        if touched.any():
            swapped = np.nan_to_num(measure_residuals(shapes, points[suspects][:, EXCHANGED[number]]) / limit)
            worst = np.where(touched, swapped.max(axis=0), np.inf)
            pairs[suspects[worst < best]] = number
            best = np.minimum(best, worst)
    # neighbouring frames whose residual is smaller with the exchange: noise hides single frames
    for pair in np.unique(pairs[pairs >= 0]).tolist():
        swapped = measure_residuals(shapes, points[:, EXCHANGED[pair]])
        better = (np.nansum(swapped, axis=0) < np.nansum(residual, axis=0)) | (pairs == pair)
        for first, stop in np.flatnonzero(np.diff(np.r_[False, better, False])).reshape(-1, 2):
            if np.mean(pairs[first:stop] == pair) > 1 / 4:
                pairs[first:stop] = pair
    starts = np.flatnonzero(np.diff(pairs, prepend=-1))
    swaps = tuple(
        Swap((layout.finger[PAIRS[pairs[first]][0]], layout.finger[PAIRS[pairs[first]][1]]), int(first), int(stop) - 1)
        for first, stop in pairwise([*starts, len(pairs)])
        if pairs[first] >= 0
    )
    spoilt, remarks = bad & (pairs < 0), []
    for name, shape, level, lost in zip(SEGMENTS, shapes, limit[:, 0], spoilt):
        sides = np.sort(np.linalg.norm(shape - np.roll(shape, -1, axis=0), axis=1))
        if (near := np.diff(sides).min()) < 2 * level:
            remarks.append(f"{name} triad: two sides differ by {1e3 * near:.1f} mm only, some swaps would not be seen")
        if count := np.count_nonzero(lost):
            remarks.append(f"{name} triad: {count} frames left out: wrong shape that no exchange corrects")
    return LabelCheck(shapes, swaps, spoilt, tuple(remarks))


def exchange_labels(recording: Recording, swaps: tuple[Swap, ...]) -> Recording:
    """Exchange the swapped markers of a recording."""
    positions = recording.positions.copy()
    for swap in swaps:
        pair, span = [recording.names.index(name) for name in swap.names], slice(swap.first, swap.last + 1)
        positions[span, pair] = positions[span, pair[::-1]]
    return replace(recording, positions=positions)


def measure_residuals(shapes: np.ndarray, points: np.ndarray) -> np.ndarray:
    """RMS residual (4, frames) [m] of points (frames, 12, 3) [m], NaN where a marker is missing."""
    return np.stack([rigid.fit_pose(shape, points[:, 3 * k : 3 * k + 3])[1] for k, shape in enumerate(shapes)])


def measure_triads(points: np.ndarray, layout: Layout, source: str) -> np.ndarray:
    """Triads (4, 3, 3) [m] in their own frames from points (frames, 12, 3) [m]. InputError for a collinear one."""
    shapes = []
    for k, names in enumerate(layout.segments):
        triad, words = points[:, 3 * k : 3 * k + 3], f"{source}: markers {', '.join(names)}"
        whole = triad[np.isfinite(triad).all(axis=(1, 2))]
        if not len(whole):
            raise InputError(f"{words} are never seen together")
        side = np.median(np.linalg.norm(whole - np.roll(whole, -1, axis=1), axis=2), axis=0)
        base, right, left = side
        along = (base**2 + left**2 - right**2) / (2 * base) if base > 0 else 0.0
        height = np.sqrt(max(left**2 - along**2, 0.0))
        if (low := base * height / max(side)) < FLATTEST:
            raise InputError(f"{words} lie on a line (height {1e3 * low:.2f} mm), which determines no frame")
        shapes.append(rigid.corners() @ np.array([base, along, height]))
    return np.stack(shapes)


class Hand(NamedTuple):
    """True parameters of a synthetic hand."""

    lengths: tuple[float, float, float] = LENGTHS  # of the phalanges [m]
    # of the MCP, PIP, DIP centres along x, y, z at rest [m/rad]
    slopes: tuple[tuple[float, ...], ...] = ((-1.0e-3, -1.5e-3, 0), (-2.72e-3, 1.91e-3, 0), (-0.71e-3, 0.26e-3, 0))
    flexion: tuple[tuple[float, float], ...] = SPONTANEOUS  # ranges of motion [rad]
    abduction: tuple[float, float] = (-0.26, 0.26)


class Faults(NamedTuple):
    """Faults of a synthetic recording."""

    noise: float = 0.0  # RMS per axis [m]
    artefact: float = 0.0  # skin motion of each marker, in a random direction [m/rad]
    dropouts: float = 0.0  # gaps per marker and minute
    gap: float = 0.05  # their duration [s]


class Truth(NamedTuple):
    """Truth of a synthetic recording; each axis is in the frame of the triad before it, its centre normal to it."""

    angles: np.ndarray  # (frames, 4) of abduction, MCP, PIP, DIP [rad]
    axes: tuple[rigid.Axis, rigid.Axis, rigid.Axis, rigid.Axis]
    lengths: tuple[float, float, float]  # [m]


def synthesise(hand: Hand, faults: Faults, duration: float, rate: float, seed: int) -> tuple[Recording, Truth]:
    """Synthesise a recording and its truth; the finger rests for the first second, then moves over its ranges.

    Raises:
        InputError: For a duration outside 3 s to an hour, a rate outside 5 to 1000 Hz, or faults below 0.
    """
    if not (3 <= duration <= 3600 and 5 <= rate <= 1000):
        raise InputError(f"synthesise: {duration:g} s at {rate:g} Hz, wanted 3 to 3600 s at 5 to 1000 Hz")
    for name, value in faults._asdict().items():
        if not 0 <= value < np.inf:
            raise InputError(f"synthesise: {name} is {value:g}, wanted a number from 0")
    rng = np.random.default_rng(seed)
    time = np.arange(round(duration * rate)) / rate
    # angles: rest, then sines
    (low, high), number = np.transpose([hand.abduction, *hand.flexion]), np.arange(4)
    phase = 2 * np.pi * (0.19 + 0.06 * number) * time[:, None] + 0.7 * number
    angles = smooth((time - 1.0) / 1.5)[:, None] * ((low + high) / 2 + (high - low) / 2 * np.sin(phase))
    # finger at rest, the tip marker at its end
    joints = np.outer(np.cumsum([0.0, hand.lengths[0], hand.lengths[1]]), [1, 0, 0])
    palmar, dorsal, still = np.array([0.0, 0, -1]), np.array([0.0, 1, 0]), np.zeros(3)
    bends = [rigid.Axis(palmar, place, np.array(g, dtype=float)) for place, g in zip(joints, hand.slopes)]
    axes = (rigid.Axis(dorsal, still, still), *bends)
    rest = {name: MM * np.array(places, dtype=float) for name, places in PLACES.items()}
    rest["distal"][1, 0] = hand.lengths[2]
    for name, place in zip(SEGMENTS[1:], joints):
        rest[name] += place
    # skin drags each marker along with the angle of the proximal joint
    places, poses = [], rigid.chain_poses(axes, angles)
    for number, name in enumerate((*SEGMENTS, "thumb")):
        before = number + 1 if 0 < number < 4 else 0
        nearest = angles[:, before - 1] if before else np.zeros(len(time))
        ways = rng.standard_normal((len(rest[name]), 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        dragged = rest[name] + faults.artefact * nearest[:, None, None] * ways
        places.append(rigid.apply(poses[before], dragged))
    # the hand drifts and turns slowly
    turn = np.array([0.48, 0.6, 0.64]) * (0.7 + 0.25 * np.sin(0.7 * time))[:, None]
    waves = (0.03 * np.sin(0.6 * time), 0.02 * np.sin(0.9 * time), 0.02 * np.cos(0.5 * time))
    shift = np.array([0.4, 0.1, 0.9]) + np.stack(waves, axis=1)
    positions = rigid.apply(rigid.motion(Rotation.from_rotvec(turn).as_matrix(), shift), np.concatenate(places, axis=1))
    positions = positions + faults.noise * rng.standard_normal(positions.shape)
    gap = max(1, round(faults.gap / (time[1] - time[0])))
    for marker in range(positions.shape[1]):
        count = rng.poisson(faults.dropouts * time[-1] / 60) if faults.dropouts else 0
        for first in rng.integers(0, len(time), size=count):
            positions[first : first + gap, marker] = np.nan
    layout = Layout()
    recording = Recording((*layout.finger, *layout.thumb), time, positions, f"synthetic, seed {seed}")
    seen = [a.express_in(rigid.triad_pose(rest[n])) for a, n in zip(axes, ("base", *SEGMENTS[:3]), strict=True)]
    return recording, Truth(angles, tuple(seen), hand.lengths)  # type: ignore[arg-type]


def truth_yaml(truth: Truth) -> str:
    """Encode the truth as YAML: lengths [m], gradient [mm/rad] and intercept [mm] of each centre."""
    lines = ["# truth of a synthetic recording"]
    lines += [f"finger.length.{joint}: {length:.5f}" for joint, length in zip(JOINTS, truth.lengths, strict=True)]
    for joint, axis in zip(JOINTS, truth.axes[1:], strict=True):
        parts = {"gradient_mm_rad": 1e3 * axis.slope, "intercept_mm": 1e3 * axis.point, "axis": axis.direction}
        lines += [f"{joint}.{name}: [{', '.join(f'{v:.4f}' for v in vector)}]" for name, vector in parts.items()]
    return "\n".join(lines) + "\n"
