"""A foreign recording as a log, by a mapping file: CSV and other text, MAT, NPY, NPZ, Parquet, ROS 2 bags in MCAP."""

from pathlib import Path

import numpy as np

from exodrake.core.child import in_child
from exodrake.core.errors import InputError
from exodrake.core.files import read_bytes
from exodrake.core.units import to_si
from exodrake.data.columns import check_columns, heading, log_from_columns
from exodrake.data.foreign.mapping import Mapped, read_mapping
from exodrake.data.foreign.tables import read_columns
from exodrake.data.foreign.track import Track
from exodrake.data.log import Log, check_clock


def import_log(file: str | Path, map_file: str | Path) -> Log:
    """A foreign recording in our names and SI.

    InputError names the file and the column or key for what is not there, not a number, or on a clock that does not
    increase. Rows that repeat the time of the row before are dropped (recorders often sample faster than the clock
    ticks).
    """
    mapped = read_mapping(map_file)
    data = read_bytes(file)
    if Path(file).name.lower().endswith(".mcap"):
        from exodrake.data.foreign.ros2 import read_tracks

        foreign = [column.foreign for column in mapped.columns]
        tracks = in_child(read_tracks, data, str(file), foreign, mapped.stamp, source=str(file), size=len(data))
        period = mapped.period or 0.02  # topics have clocks of their own, so a common one is needed
    else:
        tracks = _one_clock(read_columns(data, str(file), mapped), mapped, f"{file}")
        period = mapped.period
    time, values = _shared(tracks, str(file)) if period is None else _on_frames(tracks, period, mapped.hold, str(file))
    columns = [(heading("time", "s"), time if mapped.start is None else time - time[0] + mapped.start)]
    for column in mapped.columns:
        scaled = values[column.foreign] * column.scale + column.offset
        columns.append((heading(column.name, column.unit), scaled))
    log = log_from_columns(columns, str(file))
    check_columns(log, log.columns)
    check_clock(log)
    return log


def _one_clock(table: dict[str, np.ndarray], mapped: Mapped, source: str) -> dict[str, Track]:
    """Mapped columns of a table, on its time column or, without one, on its row number."""
    for name in [column.foreign for column in mapped.columns] + ([mapped.time] if mapped.time else []):
        if name not in table:
            raise InputError(f"{source}: no column {name!r} (it has {', '.join(table)[:400]})")
    if mapped.time is not None:
        time = to_si(table[mapped.time], mapped.time_unit, source)
    elif mapped.time_period is not None:
        time = mapped.time_period * np.arange(len(next(iter(table.values()))))
    else:
        raise InputError(f"{source}: the mapping file names no time: wanted time: {{column: ..., unit: s}}")
    missing = np.flatnonzero(~np.isfinite(time))
    if len(missing):
        raise InputError(f"{source}: time column {mapped.time!r}, row {int(missing[0]) + 1}: empty or not finite")
    lengths = {column.foreign: len(table[column.foreign]) for column in mapped.columns}
    for name, length in lengths.items():
        if length != len(time):
            raise InputError(f"{source}: column {name!r} has {length} samples, time has {len(time)}")
    fresh = np.concatenate([np.ones(min(1, len(time)), dtype=bool), np.diff(time) != 0])
    return {name: Track(time[fresh], table[name][fresh]) for name in lengths}


def _shared(tracks: dict[str, Track], source: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The clock all columns of a table share."""
    time = next(iter(tracks.values())).time
    if not len(time):
        raise InputError(f"{source}: no rows")
    return time, {name: track.values for name, track in tracks.items()}


def _on_frames(
    tracks: dict[str, Track], period: float, hold: int, source: str
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Frames from the first sample to the last; a frame carries the newest sample taken before its end.

    A sample older than `hold` frames before the frame's start is stale, and the frame is left empty.
    """
    ordered = {name: np.argsort(track.time, kind="stable") for name, track in tracks.items()}
    start = min(track.time.min() for track in tracks.values())
    end = max(track.time.max() for track in tracks.values())
    if (end - start) / period > 1e7:
        raise InputError(
            f"{source}: {end - start:.6g} s are too many frames of {period:g} s; is the unit of time right?"
        )
    count = int(np.floor((end - start) / period + 1e-6)) + 1
    time = start + period * np.arange(count)
    values = {}
    for name, track in tracks.items():
        stamps, samples = track.time[ordered[name]], track.values[ordered[name]]
        newest = np.searchsorted(stamps, time + period * (1 - 1e-6), side="left") - 1
        fresh = (newest >= 0) & (stamps[newest] >= time - period * (hold + 1e-6))
        values[name] = np.where(fresh, samples[newest], np.nan)
    return time, values
