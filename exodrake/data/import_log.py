"""A foreign recording as a log, by a mapping file (`docs/howto/import.md`) or, of joint states, by their names.

Text, MAT, HDF5, JSON, NPY, NPZ, Parquet, ROS 2 bags (MCAP or SQLite), MCAP with JSON messages and LeRobot data sets.
What is changed beyond names and units is noted beside the log.
"""

import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core import schema
from exodrake.core.errors import InputError, nearest, plural
from exodrake.core.files import is_folder, read_bytes
from exodrake.data.formats import ending, read_log, stem
from exodrake.data.formats.csv import TextLayout
from exodrake.data.log import (
    LONGEST,
    Log,
    check_clock,
    check_columns,
    fast_noise,
    fill_gaps,
    find_first,
    log_from_columns,
    merge_notes,
    other_rate,
    refuse_doubled,
)  # fmt: skip
from exodrake.data.ros2 import STATE, Track, is_bag, read_bag, read_topics
from exodrake.data.tables import TIME, element_names, episodes, is_dataset, read_columns, read_info, resolve
from exodrake.model.units import check_unit, find_kind, read_unit, to_si

BAG_PERIOD = 0.02  # s, frames of a bag whose mapping states none
ALIKE = 0.1  # relative difference of a frame and a recording's step up to which it has one sample a frame: assumed
ORDER = 4  # of the Butterworth filter, run forwards and backwards
LEAST = 0.3  # correlation below which two signals tell no delay: assumed
NOISE_ORDER = 8  # differences that leave noise of a recording, which is often finer than frames: assumed
BLIND = 0.5  # periods of the cut-off at an end, where accelerations are wrong by up to three times their RMS: assumed
JITTER = 0.05  # of a step by which a clock may vary for a filter: assumed
FINEST = 200_000  # samples on which two signals are compared
RATES = {"rad": "rad/s", "m": "m/s", "N": "N/s", "rad/s": "rad/s2", "m/s": "m/s2", "s": "-"}
ROUNDED = 1e-3  # of a frame: POSIX times as floats are rounded to a quarter of a microsecond
FEWEST = 5  # frames from which a log may have many samples a frame

COMMAND, MEASURED = "action", "observation.state"  # of a LeRobot data set
COMMANDS = ("command", "cmd", "desired", "reference", "target", "goal", "setpoint")  # in the name of a topic
KINDS = {"position": "angle", "velocity": "angle_speed", "effort": "effort"}
UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N m"}  # REP 103; a sliding joint is another matter
LARGEST, SHORTEST = 1e300, 1e-9  # of a finite number; s, a tick of the finest recorder


TEXT, WHOLE = schema.text(), schema.whole()
FINITE = schema.number(low=-LARGEST, high=LARGEST)
POSITIVE = schema.number(above=0.0, high=LARGEST)
STEP = schema.number(low=SHORTEST, high=LARGEST, unit="s")
CHANGES = {"scale": FINITE, "offset": FINITE, "filter": POSITIVE}
COLUMN = {"name": TEXT, "unit": TEXT, "sign": FINITE, "wrap": POSITIVE} | CHANGES
DERIVED = {"of": TEXT, "take": schema.text(("first", "rate")), "minus": TEXT, "unit": TEXT} | CHANGES
SYNC = {"columns": schema.listing(TEXT, least=1), "by": TEXT, "with": TEXT, "within": STEP}
TIME_KEYS = {
    "column": schema.optional(lambda value, where: TEXT(str(value) if type(value) is int else value, where)),
    "unit": TEXT, "start": schema.optional(FINITE), "period": schema.optional(STEP),
}  # fmt: skip
TIME_FIELDS = {"column": "time", "unit": "time_unit", "start": "start", "period": "time_period"}  # of `Mapped`
PLAIN = {
    "hold": WHOLE, "separator": schema.text(length=1), "decimal": schema.text(length=1), "skip": WHOLE,
    "samples": schema.text(("rows", "columns")), "stamp": schema.text(("log", "publish", "header")),
    "heading": schema.flag,
}  # fmt: skip
SCHEMA = schema.mapping(
    {
        "time": schema.optional(schema.mapping(TIME_KEYS)),
        "columns": schema.names(schema.mapping(COLUMN, required=("name", "unit")), least=1),
        "derived": schema.optional(schema.names(schema.mapping(DERIVED, required=("of",)))),
        "sync": schema.optional(schema.listing(schema.mapping(SYNC, required=tuple(SYNC)))),
        "period": schema.optional(STEP),
        **PLAIN,
    },
    required=("columns",),
)


@dataclass(frozen=True)
class Column:
    """A column of the log: sign (value * scale + offset) [SI]; a derived one: (take(of) - minus) scale + offset."""

    of: str  # foreign column, or ours of a derived one
    name: str
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    sign: float = 1.0
    wrap: float | None = None  # [unit]
    filter: float | None = None  # [Hz]
    take: str | None = None  # of a derived one "first", "rate" or ""
    minus: str = ""


@dataclass(frozen=True)
class Mapped(TextLayout):
    """Content of a mapping file, with its keys."""

    columns: tuple[Column, ...]
    time: str | None = None  # foreign column of the time; None where `time_period` counts rows
    time_unit: str = "s"
    time_period: float | None = None  # time between two rows [s]; None where there is a column of the time
    start: float | None = None  # time at which the log starts [s]; None: as recorded
    period: float | None = None  # frame period of the log [s]; None leaves rows as recorded
    hold: int = 1  # frames a sample stays valid for when none newer has come
    stamp: str = "log"
    samples: str | None = None  # "rows" or "columns" of a matrix; None: by its shape
    derived: tuple[Column, ...] = ()
    sync: tuple[dict[str, Any], ...] = ()  # each with the keys of `SYNC`

    @property
    def foreign(self) -> list[str]:
        """Foreign columns that must be there."""
        return [*(column.of for column in self.columns), *([] if self.time is None else [self.time])]


def read_mapping(path: str | Path) -> Mapped:
    """Reads and checks a mapping file. InputError names file and key."""
    content = SCHEMA(schema.read_yaml(path), str(path))
    time = content.get("time") or {}
    check_unit("time", time.get("unit", "s"), f"{path}, 'time'")
    columns, derived, known = [], [], ["time"]
    for foreign, item in content["columns"].items():
        where, name = schema.inside(f"{path}, 'columns'", foreign), item["name"].strip()
        if not name or not item["unit"].strip():
            raise schema.refusal(where, f"key {'unit' if name else 'name'!r} is missing")
        check_unit(name, item["unit"], where)
        if abs(item.get("sign", 1.0)) != 1.0:
            raise schema.refusal(schema.inside(where, "sign"), f"wanted 1 or -1, found {item['sign']:g}")
        if name in known:
            raise schema.refusal(where, f"{name!r} is the name of more than one column")
        known.append(name)
        columns.append(Column(foreign, **{**item, "name": name}))
    for name, item in (content.get("derived") or {}).items():
        where = schema.inside(f"{path}, 'derived'", name)
        for key in ("of", "minus"):
            if key in item and item[key] not in known[1:]:
                raise schema.refusal(where, f"{item[key]!r} is no column above it{nearest(item[key], known[1:])}")
        if name in known:
            raise schema.refusal(where, "is the name of another column")
        if item.get("unit"):
            check_unit(name, item["unit"], where)
        known.append(name)
        derived.append(Column(name=name, **{"take": "", **item}))
    ours = [column.name for column in columns]
    for item in content.get("sync") or ():
        where = f"{path}, 'sync'"
        for name in (*item["columns"], item["by"], item["with"]):
            if name not in ours:
                raise schema.refusal(where, f"{name!r} is no column{nearest(name, ours)}")
        if item["by"] not in item["columns"] or item["with"] in item["columns"]:
            raise schema.refusal(where, "`by` is one of the columns that are moved, and `with` is none of them")
    plain = {key: content[key] for key in ("period", *PLAIN) if key in content}
    plain |= {TIME_FIELDS[key]: value for key, value in time.items()}
    return Mapped(tuple(columns), derived=tuple(derived), sync=tuple(content.get("sync") or ()), **plain)


@dataclass(frozen=True, eq=False)
class Imported:
    """A log, what was done to its signals beyond names and units, in sentences, and noise that filters leave."""

    log: Log
    notes: tuple[str, ...]
    noise: Mapping[str, float] = field(default_factory=dict)  # filtered column -> standard deviation [SI]


def import_recording(file: str | Path, mapped: Mapped) -> Imported:
    """A foreign recording in our names and SI. InputError names file, column or key, and what is wrong with a clock."""
    if not is_bag(file):
        return convert_table(read_columns(read_bytes(file), str(file), mapped), mapped, str(file))
    period = mapped.period or BAG_PERIOD  # topics have clocks of their own
    ordered, late = {}, dict[str, None]()  # by their stamps; notes on messages overtaken by less than a frame
    for name, track in read_bag(file, [column.of for column in mapped.columns], mapped.stamp).items():
        topic, times = f"topic {name.partition(':')[0]!r}", track.time
        if len(times) > 1 and times.min() == times.max():
            still = f"its clock stands still, all {len(times)} messages at {times[0]:.10g} s"
            raise InputError(f"{file}: {topic}: {still}")
        latest = np.maximum.accumulate(times)
        back, count = latest - times, int(np.sum(times < latest))
        if (at := find_first(back > period)) is not None:
            raise InputError(
                f"{file}: {topic}: the clock steps backwards by {back.max():.6g} s, at message {at + 1}, "
                f"{times[at]:.10g} s after {latest[at]:.10g} s; cut the bag there"
            )
        if (at := find_first(times < latest)) is not None:
            first = f"the first is message {at + 1} at {times[at]:.10g} s"
            late[f"{topic}: {count} {plural(count, 'message')} out of order, {first}, sorted by their stamps"] = None
        order = np.argsort(times, kind="stable")
        ordered[name] = Track(times[order], track.values[order])
    return make_log(ordered, replace(mapped, period=period), str(file), list(late))


def import_all(
    path: Path, mapped: Mapped | None, unit: str = "", chosen: frozenset[int] = frozenset()
) -> dict[str, Imported]:
    """Logs of a recording by name: one of a file or bag, one for each (or chosen) episode of a LeRobot data set."""
    if is_dataset(path):
        mapped, found = mapped or default_dataset_mapping(path, unit), {}
        for number, (name, columns) in enumerate(episodes(path)):
            if number in chosen or not chosen:
                found[name] = convert_table(columns, mapped, f"{path}, {name}")
        if not found:
            raise InputError(f"{path}: none of the episodes of --episodes")
        return found
    if unit or chosen:
        raise InputError(f"{path}: no LeRobot data set, so neither --unit nor --episodes says anything")
    refuse_folder(path)
    if mapped is None and not is_bag(path):
        if not ending(path):
            raise InputError(f"{path}: wanted --map FILE; without --out, import lists the columns")
        return {stem(path): Imported(read_log(path), ())}
    return {stem(path): import_recording(path, mapped or default_bag_mapping(path))}


def frame_period(logs: Sequence[Log], mapped: Mapped | None, frame: float) -> float:
    """Frame [s] of a case of imported logs: of the mapping, of the machine if all logs fit it, else of the first."""
    if mapped is not None and mapped.period is not None:
        return mapped.period

    def count_otherwise(log: Log, step: float) -> tuple[float, float] | None:
        return other_rate(log.time, np.concatenate([[0], np.cumsum(np.rint(np.diff(log.time) / step))]), step)

    step = logs[0].dt
    if all(abs(o.dt / frame - 1.0) < ALIKE and not count_otherwise(o, frame) for o in logs if len(o) > 1):
        return frame
    return round((count_otherwise(logs[0], step) or (0.0, step))[1], 9)  # the mean step where stamps are rounded


def refuse_folder(path: Path) -> None:
    """InputError for a folder that holds no bag."""
    if is_folder(path) and not is_bag(path):
        raise InputError(f"{path}: a folder without a ROS 2 bag or a LeRobot data set; wanted one, or a file")


def make_log(tracks: dict[str, Track], mapped: Mapped, source: str, notes: Sequence[str] = ()) -> Imported:
    """Foreign columns with their clocks, in order of time, as a log of ours; `notes`: what was done to them before."""
    ours = {}
    for column in mapped.columns:
        values = tracks[column.of].values.copy()
        if column.wrap is not None:  # readings start again: made continuous
            there, span = np.isfinite(values), np.nanmax(values, initial=-np.inf) - np.nanmin(values, initial=np.inf)
            found = np.unwrap(values[there], period=column.wrap)
            if span > column.wrap * (1.0 + ROUNDED) and not np.array_equal(found, values[there]):
                wide = f"{column.name} spans {span:g} {column.unit}, more than wrap: {column.wrap:g}"
                raise InputError(f"{source}: {wide}, which is in the column's unit, too")
            values[there] = found
        values = column.sign * (values * column.scale + column.offset)
        ours[column.name] = Track(tracks[column.of].time, to_si(values, column.unit, source))
    if mapped.start is not None:  # before frames are laid, since stamps since 1970 have few digits below a microsecond
        first = min((track.time.min() for track in ours.values() if len(track.time)), default=0.0)
        ours = {name: Track(track.time - first + mapped.start, track.values) for name, track in ours.items()}
    notes = [*notes]
    for entry in mapped.sync:
        by, to, within = entry["by"], entry["with"], entry["within"]
        lag, correlation = find_lag(ours[by], ours[to], within, f"{source}: sync of {by} with {to}")
        ours |= {name: Track(ours[name].time - lag, ours[name].values) for name in entry["columns"]}
        moved = f"{', '.join(entry['columns'])}: moved by {-1e3 * lag:+.3g} ms to fit {to}"
        notes.append(f"{moved} (correlation {correlation:.3f}), so a delay between them, of a clock or real, is gone")
    if mapped.period is not None:
        smooth = {column.of for column in mapped.derived if column.take == "rate" or column.filter}
        smooth |= {column.name for column in mapped.columns if column.filter}
        time, values, lost = lay_on_frames(ours, mapped.period, mapped.hold, source, smooth)
        notes += lost
    else:
        late = {name for entry in mapped.sync for name in entry["columns"]}  # interpolated on the clock of the others
        time = next(track.time for name, track in ours.items() if name not in late)
        values = {name: track.values for name, track in ours.items()}
        for name in late:
            values[name] = np.interp(time, ours[name].time, ours[name].values, left=np.nan, right=np.nan)
    if not len(time):
        raise InputError(f"{source}: no rows")
    units = {column.name: read_unit(column.unit).si for column in mapped.columns}
    blind = {column.name: BLIND / (column.filter or np.inf) for column in mapped.columns}  # s at both ends
    for column in mapped.derived:
        blind[column.name] = max(blind[column.of], blind.get(column.minus, 0.0)) + BLIND / (column.filter or np.inf)
    ends, impulse = max(blind.values()), (np.arange(len(time)) == len(time) // 2).astype(float)
    white, response = dict[str, float](), dict[str, np.ndarray]()  # noise of the recorded column, what is made of it
    for column in mapped.columns:
        name, both = column.name, (values[column.name], impulse)
        white[name] = fast_noise(fill_gaps(values[name]), NOISE_ORDER) if ends else 0.0
        if column.filter is not None:
            both = tuple(low_pass(time, one, column.filter, f"{source}: {name}") for one in both)
        values[name], response[name] = both
    if not (seen := np.minimum(time - time[0], time[-1] - time) >= ends).any():
        raise InputError(
            f"{source}: {time[-1] - time[0]:g} s, too short for filters that need {ends:.2g} s at both ends"
        )
    for column in mapped.derived:
        found, unit, where = values[column.of], units[column.of], f"{source}: {column.name}"
        passed = response[column.of]
        if column.minus:
            if units[column.minus] != unit:
                raise InputError(f"{where}: {column.of} is in {unit}, {column.minus} in {units[column.minus]}")
            found = found - values[column.minus]
        if column.take == "first":
            if (first := find_first(np.isfinite(found) & seen)) is None:
                raise InputError(f"{where}: {column.of} is empty")
            found, passed = np.full(len(found), found[first]), np.zeros(len(found))
        if column.filter is not None:
            found, passed = (low_pass(time, one, column.filter, where) for one in (found, passed))
        if column.take == "rate":
            if len(time) < 3:
                raise InputError(f"{where}: {len(time)} rows, too few for a derivative")
            found, passed = (np.gradient(one, time, edge_order=2) for one in (found, passed))
            unit = RATES.get(unit, "")
        unit = read_unit(column.unit).si if column.unit else unit
        if not unit:
            raise InputError(f"{where}: state its SI unit, `unit: ...`")
        values[column.name], units[column.name] = found * column.scale + column.offset, unit
        white[column.name], response[column.name] = white[column.of], passed * column.scale
    ours = ((f"{name} [{unit}]", values[name][seen]) for name, unit in units.items())
    log = log_from_columns([("time [s]", time[seen]), *ours], source)
    check_columns(log, log.columns)
    check_clock(log)
    said = dict[str, list[str]]()
    for column in (*mapped.columns, *mapped.derived):  # what is done to it beyond its unit
        done, channel = [], column.name.removeprefix(find_kind(column.name) or "")
        if column.take is not None and column.take != "first":
            minus = f" minus {column.minus}" if column.minus else ""
            of = column.of.removesuffix(channel) or column.of
            done.append(f"{'the derivative of ' if column.take else ''}{of}{minus}")
        if column.wrap is not None:
            done.append(f"made continuous where readings start again after {column.wrap:g}")
        if column.sign < 0.0:
            done.append("sign turned")
        if column.filter is not None:
            done.append(f"low-passed at {column.filter:g} Hz without phase, so its fast noise is not the sensor's")
        said[column.name] = [", ".join(done)] if done else []
    if not seen.all():
        notes.append(f"{ends:.2g} s at both ends left out, where a filter does not know how it goes on")
    noise = {name: white[name] * float(np.linalg.norm(response[name])) for name in units if blind[name]}
    return Imported(log, (*notes, *merge_notes(said, "")), noise)


def convert_table(table: dict[str, np.ndarray], mapped: Mapped, source: str) -> Imported:
    """`make_log` of the columns of a table, on its time column or, without one, on its row number."""
    names = {name: resolve(name, table) for name in mapped.foreign}
    for name, found in names.items():
        if found not in table:
            there = ", ".join(table)[:400]
            raise InputError(f"{source}: no column {name!r}, which the mapping file names (it has {there})")
    where = f"{source}: time column {mapped.time!r}"
    if mapped.time is not None:
        time = to_si(table[names[mapped.time]], mapped.time_unit, source)
    elif mapped.time_period is not None:
        time = mapped.time_period * np.arange(len(table[names[mapped.columns[0].of]]))
    else:
        raise InputError(f"{source}: the mapping file names no time: wanted time: {{column: ..., unit: s}}")
    if (row := find_first(~np.isfinite(time))) is not None:
        raise InputError(f"{where}, row {row + 1}: empty or not finite")
    lengths = {column.of: len(table[names[column.of]]) for column in mapped.columns}
    for name, length in lengths.items():
        if length != len(time):
            raise InputError(f"{source}: column {name!r} has {length} samples, time has {len(time)}")
    if (row := find_first(np.diff(time) < 0)) is not None:
        after = f"{time[row + 1]:.10g} s does not come after {time[row]:.10g} s"
        raise InputError(f"{where}, row {row + 2}: {after}; cut the recording there")
    fresh = np.concatenate([np.ones(min(1, len(time)), dtype=bool), np.diff(time) != 0])
    if len(time) > 1 and fresh.sum() == 1:
        raise InputError(f"{where}: the clock stands still, all {len(time)} rows at {time[0]:.10g} s")
    notes = []
    if (row := find_first(~fresh)) is not None:
        share = f"{int((~fresh).sum())} of {len(time)} rows have the time of the row before and are dropped"
        notes = [f"{share}, the first is row {row + 1} at {time[row]:.10g} s"]
    lost = dict[str, list[str]]()
    for name in lengths:
        empty = np.isnan(table[names[name]])
        if empty.any() and not empty.all():
            lost[name] = [f"{empty.sum()} of {len(time)} samples are missing, the first in row {empty.argmax() + 1}"]
    notes += merge_notes(lost, "")
    return make_log({name: Track(time[fresh], table[names[name]][fresh]) for name in lengths}, mapped, source, notes)


def lay_on_frames(
    tracks: dict[str, Track], period: float, hold: int, source: str, smooth: Set[str]
) -> tuple[np.ndarray, dict[str, np.ndarray], list[str]]:
    """Frames from the first sample to the last, each with the newest sample taken before its end, and notes.

    A sample older than `hold` frames is stale. Where a clock has about one sample a frame, frames lie about their
    samples, so that jitter neither loses nor repeats one. On any other clock the newest sample is older in one frame
    than in the next, which a derivative takes for motion: tracks of `smooth` have the value, between two samples, of
    the age that their newest one has on average.
    """
    start = min(track.time.min() for track in tracks.values())
    end = max(track.time.max() for track in tracks.values())
    most, frames = max(len(track.time) for track in tracks.values()), (end - start) / period + ROUNDED
    if frames < FEWEST - 1 and most > FEWEST**2:
        raise InputError(f"{source}: {most} samples in {end - start:.3g} s; is the unit of time right?")
    if frames > min(1e7, LONGEST * (most + LONGEST)):
        many = f"{frames:.0f} frames of {period:g} s for {most} samples are too many"
        raise InputError(f"{source}: {many}; is the unit of time right? Else cut it where its clock jumps")
    step = median_step(np.unique(np.concatenate([track.time for track in tracks.values()])))
    about = abs(step / period - 1.0) < ALIKE
    time = start + period * np.arange(int(np.rint(frames) if about else np.floor(frames)) + 1)
    begin = time - 0.5 * period if about else time
    values, said = {}, dict[str, list[str]]()
    for name, track in tracks.items():
        newest = np.searchsorted(track.time, begin + period * (1 - ROUNDED), side="left") - 1
        fresh = (newest >= 0) & (track.time[newest] >= begin - period * (hold + ROUNDED))
        found, between = track.values[newest], name in smooth and not about
        if between:
            found = np.interp(begin + period - 0.5 * median_step(track.time), track.time, track.values)
        values[name] = np.where(fresh, found, np.nan)
        taken = np.where(fresh, newest, -1)
        left = np.setdiff1d(np.arange(len(track.time)), taken)
        again = np.flatnonzero((np.diff(taken) == 0) & (taken[1:] >= 0)) + 1
        empty = np.flatnonzero(taken < 0)
        kinds = {
            f"{len(left)} dropped for a newer one in the same frame": track.time[left],
            f"{len(again)} repeat the sample before": time[again], f"{len(empty)} left empty": time[empty],
        }  # fmt: skip
        kept = [f"{what}, the first at {at[0]:.10g} s" for what, at in list(kinds.items())[2 * between :] if len(at)]
        parts = "; ".join([*(["interpolated"] if between else []), *kept])
        frames = f"{len(track.time)} samples on {len(time)} frames of {period * 1e3:g} ms"
        said[name] = [f"{frames}: {parts}"] if parts else []
    return time, values, merge_notes(said, "all columns")


def median_step(time: np.ndarray) -> float:
    """Median step of a clock (n,) [s]; infinite with a single sample."""
    return float(np.median(np.diff(time))) if len(time) > 1 else float("inf")


def low_pass(time: np.ndarray, values: np.ndarray, cutoff: float, where: str) -> np.ndarray:
    """Values (n,) through a zero-phase Butterworth filter: half the amplitude at `cutoff` [Hz]; NaN stays NaN.

    Beyond its ends the log goes on along a cubic through its first and last period of the cut-off. Turned about its
    end, as by default, a log that begins in motion would have an acceleration there that is wrong by its own size.
    """
    from scipy.signal import butter, sosfiltfilt

    steps, known = np.diff(time), np.isfinite(values)
    if len(time) < 8 * ORDER or known.sum() < 2:
        raise InputError(f"{where}: {int(known.sum())} samples, too few for a filter")
    step = float(np.median(steps))
    if np.abs(steps - step).max() > JITTER * step:
        raise InputError(f"{where}: a filter wants an even clock; put the rows on frames with `period`")
    if cutoff >= 0.5 / step:
        raise InputError(f"{where}: filter: {cutoff:g} Hz, wanted below half the sampling rate, {0.5 / step:g} Hz")
    if cutoff * (time[-1] - time[0]) < 1.0:
        slowest = 1.0 / (time[-1] - time[0])
        raise InputError(f"{where}: filter: {cutoff:g} Hz, wanted above one period in the log, {slowest:.3g} Hz")
    filled = np.interp(time, time[known], values[known])
    sections, width = butter(ORDER, 2.0 * step * cutoff, output="sos"), max(int(1.0 / (cutoff * step)), 8)
    near, beyond = np.arange(width), np.arange(-2 * width, 0)
    before, after = (np.polyval(np.polyfit(near, end[:width], 3), beyond) for end in (filled, filled[::-1]))
    passed = sosfiltfilt(sections, np.concatenate([before, filled, after[::-1]]))[2 * width : -2 * width]
    return np.where(known, passed, np.nan)


def find_lag(moved: Track, fixed: Track, within: float, where: str) -> tuple[float, float]:
    """Lag of `moved` behind `fixed` [s] with the largest correlation, `within` [s] either way, and that correlation."""
    from scipy.signal import correlate

    ordered = (np.argsort(track.time, kind="stable") for track in (moved, fixed))
    known = [order[np.isfinite(t.values[order])] for t, order in zip((moved, fixed), ordered)]
    a, b = (Track(t.time[rows], t.values[rows]) for t, rows in zip((moved, fixed), known))
    step = min(median_step(t.time) for t in (a, b))
    start = max(a.time[0] + within, b.time[0]) if len(a.time) and len(b.time) else np.inf
    end = min(a.time[-1] - within, b.time[-1]) if start < np.inf else -np.inf
    if not (step < np.inf and end - start > 2.0 * within):
        raise InputError(f"{where}: they overlap too little to be compared within {within:g} s")
    step = max(step, (end - start) / FINEST)
    reach = max(int(within / step), 1)
    times = start + step * np.arange(int((end - start) / step))
    wide = start + step * np.arange(-reach, len(times) + reach)
    late, here = np.interp(wide, a.time, a.values), np.interp(times, b.time, b.values)
    late, here = late - late.mean(), here - here.mean()
    ones = np.ones(len(here))
    sums, squares = (correlate(x, ones, mode="valid", method="fft") for x in (late, late**2))
    spread = np.sqrt(np.maximum(squares - sums**2 / len(here), 0.0)) * np.linalg.norm(here)
    if not spread.min() > 1e-9 * max(spread.max(), np.linalg.norm(here) ** 2 * 1e-9):
        raise InputError(f"{where}: one of them does not move")
    course = np.abs(correlate(late, here, mode="valid", method="fft")) / spread
    at = int(course.argmax())
    if course[at] < LEAST:
        raise InputError(f"{where}: correlation {course[at]:.2f} at best, so the lag is unknown")
    offset = 0.0
    if 0 < at < len(course) - 1:  # vertex of the parabola through the largest sample and its neighbours
        before, top, after = course[at - 1 : at + 2]
        bend = before - 2.0 * top + after
        offset = float(0.5 * (before - after) / bend) if bend < 0.0 else 0.0
    return (at + offset - reach) * step, float(course[at])


def default_bag_mapping(path: str | Path) -> Mapped:
    """Joint states by their names: positions as angles, or as commands where the topic's name says so."""
    columns: dict[str, Column] = {}
    for topic, (kind, _, fields) in read_topics(path).items():
        if kind.replace("/msg/", "/") != STATE.replace("/msg/", "/"):
            continue
        commanded = any(word in topic.lower() for word in COMMANDS)
        for one in fields or ():
            what, _, joint = one.rstrip("]").partition("[")
            if what not in KINDS:
                continue
            ours = f"{KINDS[what]}{'_ref' if commanded and what != 'velocity' else ''}_{joint_name(joint)}"
            found = Column(f"{topic}:{one}", ours, UNITS[what])
            if (other := columns.setdefault(ours, found)) is not found:
                both = f"{other.of!r} and {found.of!r} are both {ours}"
                raise InputError(f"{path}: {both}; write a mapping file that takes one of them")
    if not columns:
        advice = "write a mapping file (import without --out lists)"
        raise InputError(f"{path}: no topic of {STATE} with positions; {advice}")
    angles = [n for n in columns if n.startswith("angle_") and not n.startswith(("angle_ref_", "angle_speed_"))]
    starts = tuple(Column(n, n.replace("angle_", "angle_start_", 1), take="first") for n in angles)
    first = next(iter(columns.values())).of
    steps = np.diff(read_bag(path, [first], "header")[first].time)
    period = float(f"{np.median(steps):.3g}") if len(steps) and np.median(steps) > 0.0 else None
    return Mapped(tuple(columns.values()), start=0.0, stamp="header", derived=starts, period=period)


def default_dataset_mapping(path: Path, unit: str) -> Mapped:
    """Actions as commands and states as angles of a LeRobot data set, in a unit that it does not state."""
    info = read_info(path)
    if not unit:
        raise InputError(f"{path}: a LeRobot data set states no unit of its joints; --unit deg, for instance")
    command, measured = element_names(info, COMMAND), element_names(info, MEASURED)
    if not command or command != measured:
        raise InputError(f"{path}: {COMMAND} and {MEASURED} do not name the same joints; write a mapping file")
    joints = [joint_name(name) for name in command]
    refuse_doubled(joints, f"{path}: joints of {COMMAND}")
    columns = tuple(
        Column(f"{foreign}[{name}]", f"{kind}_{joint}", unit)
        for name, joint in zip(command, joints)
        for foreign, kind in ((COMMAND, "angle_ref"), (MEASURED, "angle"))
    )
    starts = tuple(Column(f"angle_{joint}", f"angle_start_{joint}", take="first") for joint in joints)
    return Mapped(columns, time=TIME, start=0.0, period=1.0 / float(info["fps"]), derived=starts)


def joint_name(name: str) -> str:
    """`shoulder_pan.pos` as a channel: `shoulderPan`."""
    bare = name.removesuffix(".pos").removesuffix("_pos").removesuffix(".position")
    words = [word for word in re.split("[-._]", bare) if word]
    if not words:
        raise InputError(f"{name!r} is no name of a joint; write a mapping file")
    return words[0] + "".join(word[0].upper() + word[1:] for word in words[1:])
