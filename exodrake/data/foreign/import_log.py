"""A foreign recording as a log, by a mapping file or, of joint states, by their names.

Text, MAT, HDF5, JSON, NPY, NPZ, Parquet, ROS 2 bags (MCAP or SQLite) and LeRobot data sets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import is_folder, read_bytes
from exodrake.core.units import si_unit, to_si
from exodrake.data.columns import check_columns, log_from_columns
from exodrake.data.foreign import lerobot
from exodrake.data.foreign.derive import derived, low_passed, note_of, scaled, synchronised
from exodrake.data.foreign.mapping import Mapped, read_mapping
from exodrake.data.foreign.ros2 import default_mapping, is_bag, read_bag
from exodrake.data.foreign.tables import read_columns, slashed
from exodrake.data.foreign.track import Track, has_one_sample_a_frame, median_step
from exodrake.data.formats import ending, stem
from exodrake.data.headings import heading
from exodrake.data.log import Log, check_clock
from exodrake.data.log_file import read_log

PERIOD = 0.02  # s, frames of a bag whose mapping states none
ROUNDED = 1e-3  # of a frame: POSIX times as floats are rounded to a quarter of a microsecond


@dataclass(frozen=True, eq=False)
class Imported:
    """A log, and what was done to its signals beyond names and units, in sentences."""

    log: Log
    notes: tuple[str, ...]


def import_log(file: str | Path, map_file: str | Path) -> Log:
    """A foreign recording in our names and SI.

    InputError names the file and the column or key for what is not there, not a number, or on a clock that does not
    increase. Rows that repeat the time of the row before are dropped (recorders often sample faster than the clock
    ticks).
    """
    return import_recording(file, read_mapping(map_file)).log


def import_recording(file: str | Path, mapped: Mapped) -> Imported:
    """`import_log` by a mapping that is read already, with notes."""
    if is_bag(file):
        tracks = read_bag(file, [column.foreign for column in mapped.columns], mapped.stamp)
        mapped = replace(mapped, period=mapped.period or PERIOD)  # topics have clocks of their own
    else:
        tracks = _one_clock(read_columns(read_bytes(file), str(file), mapped), mapped, str(file))
    return imported(tracks, mapped, str(file))


def import_all(
    path: Path, mapped: Mapped | None, unit: str = "", chosen: frozenset[int] = frozenset()
) -> dict[str, Imported]:
    """Every log of a recording by name: one of a file or bag, one for each episode of a LeRobot data set.

    Args:
        path: recording.
        mapped: mapping; None: that of joint states, or of actions and states.
        unit: of the joints of a LeRobot data set without a mapping.
        chosen: episodes; all if empty.

    Raises:
        InputError: as `import_log`, and for a recording that needs a mapping.
    """
    if lerobot.is_dataset(path):
        mapped = mapped or lerobot.default_mapping(path, unit)
        found = {}
        for number, (name, columns) in enumerate(lerobot.episodes(path)):
            if number in chosen or not chosen:
                where = f"{path}, {name}"
                found[name] = imported(_one_clock(columns, mapped, where), mapped, where)
        if not found:
            raise InputError(f"{path}: none of the episodes of --episodes")
        return found
    if unit or chosen:
        raise InputError(f"{path}: no LeRobot data set, so neither --unit nor --episodes says anything")
    refuse_folder(path)
    if mapped is None and ending(path) and not is_bag(path):
        return {stem(path): Imported(read_log(path), ())}
    if mapped is None and not is_bag(path):
        raise InputError(f"{path}: wanted --map FILE; without --out, import lists the columns")
    return {stem(path): import_recording(path, mapped or default_mapping(path))}


def frame_period(logs: Sequence[Log], mapped: Mapped | None, frame: float) -> float:
    """Frame period [s] of a case of imported logs.

    Args:
        logs: the logs of the case.
        mapped: mapping; the period that it states holds.
        frame: frame of the machine [s], taken if every log has about one row in each; else the first one's median step.

    Raises:
        InputError: for a first log of a single row, unless the mapping states a period.
    """
    if mapped is not None and mapped.period is not None:
        return mapped.period
    measured = logs[0].dt
    steps = [median_step(log.time) for log in logs if len(log) > 1]
    return frame if all(has_one_sample_a_frame(step, frame) for step in steps) else round(measured, 9)


def refuse_folder(path: Path) -> None:
    """InputError for a folder that holds no bag."""
    if is_folder(path) and not is_bag(path):
        raise InputError(f"{path}: a folder without a ROS 2 bag or a LeRobot data set; wanted one, or a file")


def imported(tracks: dict[str, Track], mapped: Mapped, source: str) -> Imported:
    """Foreign columns with their clocks as a log of ours."""
    ours = {}
    for column in mapped.columns:
        track = tracks[column.foreign]
        ours[column.name] = Track(track.time, to_si(scaled(column, track.values), column.unit, source))
    if mapped.start is not None:  # before frames are laid, since stamps since 1970 have few digits below a microsecond
        first = min((track.time.min() for track in ours.values() if len(track.time)), default=0.0)
        ours = {name: Track(track.time - first + mapped.start, track.values) for name, track in ours.items()}
    ours, notes = synchronised(ours, mapped.sync, source)
    if mapped.period is not None:
        time, values = _on_frames(ours, mapped.period, mapped.hold, source)
    else:
        time, values = _shared(ours, source, {name for entry in mapped.sync for name in entry.columns})
    columns = [(heading("time", "s"), time)]
    for column in mapped.columns:
        if column.filter is not None:
            values[column.name] = low_passed(time, values[column.name], column.filter, f"{source}: {column.name}")
        columns.append((heading(column.name, si_unit(column.unit)), values[column.name]))
    units = {column.name: si_unit(column.unit) for column in mapped.columns}
    for column in mapped.derived:
        values[column.name], units[column.name] = derived(column, time, values, units, source)
        columns.append((heading(column.name, units[column.name]), values[column.name]))
    log = log_from_columns(columns, source)
    check_columns(log, log.columns)
    check_clock(log)
    notes += filter(None, map(note_of, (*mapped.columns, *mapped.derived)))
    return Imported(log, tuple(notes))


def _one_clock(table: dict[str, np.ndarray], mapped: Mapped, source: str) -> dict[str, Track]:
    """Mapped columns of a table, on its time column or, without one, on its row number."""
    wanted = [column.foreign for column in mapped.columns] + ([mapped.time] if mapped.time else [])
    names = {name: slashed(name, table) for name in wanted}
    for name, found in names.items():
        if found not in table:
            raise InputError(f"{source}: no column {name!r} (it has {', '.join(table)[:400]})")
    if mapped.time is not None:
        time = to_si(table[names[mapped.time]], mapped.time_unit, source)
    elif mapped.time_period is not None:
        time = mapped.time_period * np.arange(len(table[names[mapped.columns[0].foreign]]))
    else:
        raise InputError(f"{source}: the mapping file names no time: wanted time: {{column: ..., unit: s}}")
    missing = np.flatnonzero(~np.isfinite(time))
    if len(missing):
        raise InputError(f"{source}: time column {mapped.time!r}, row {int(missing[0]) + 1}: empty or not finite")
    lengths = {column.foreign: len(table[names[column.foreign]]) for column in mapped.columns}
    for name, length in lengths.items():
        if length != len(time):
            raise InputError(f"{source}: column {name!r} has {length} samples, time has {len(time)}")
    fresh = np.concatenate([np.ones(min(1, len(time)), dtype=bool), np.diff(time) != 0])
    return {name: Track(time[fresh], table[names[name]][fresh]) for name in lengths}


def _shared(tracks: dict[str, Track], source: str, moved: set[str]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The clock all columns of a table share; those that were moved in time, interpolated on it."""
    time = next(track.time for name, track in tracks.items() if name not in moved)
    if not len(time):
        raise InputError(f"{source}: no rows")
    values = {name: track.values for name, track in tracks.items()}
    for name in moved:
        values[name] = np.interp(time, tracks[name].time, tracks[name].values, left=np.nan, right=np.nan)
    return time, values


def _on_frames(
    tracks: dict[str, Track], period: float, hold: int, source: str
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Frames from the first sample to the last; a frame carries the newest sample taken before its end.

    A sample older than `hold` frames before the frame's start is stale, and the frame is left empty. Where a clock has
    about one sample a frame, frames lie about their samples, so that jitter of the clock neither loses nor repeats one.
    """
    ordered = {name: np.argsort(track.time, kind="stable") for name, track in tracks.items()}
    start = min(track.time.min() for track in tracks.values())
    end = max(track.time.max() for track in tracks.values())
    if (end - start) / period > 1e7:
        raise InputError(
            f"{source}: {end - start:.6g} s are too many frames of {period:g} s; is the unit of time right?"
        )
    count = int(np.floor((end - start) / period + ROUNDED)) + 1
    time = start + period * np.arange(count)
    step = median_step(np.unique(np.concatenate([track.time for track in tracks.values()])))
    begin = time - 0.5 * period if has_one_sample_a_frame(step, period) else time
    values = {}
    for name, track in tracks.items():
        stamps, samples = track.time[ordered[name]], track.values[ordered[name]]
        newest = np.searchsorted(stamps, begin + period * (1 - ROUNDED), side="left") - 1
        fresh = (newest >= 0) & (stamps[newest] >= begin - period * (hold + ROUNDED))
        values[name] = np.where(fresh, samples[newest], np.nan)
    return time, values
