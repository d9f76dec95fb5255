"""What every file format has in common: columns to logs, required columns, limits of size."""

from collections.abc import Iterable, Sequence

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.units import KINDS
from exodrake.data.headings import LARGEST, columns_in_si, heading
from exodrake.data.log import Log

MAX_SAMPLES = 20_000_000  # assumed: an hour of 100 columns at 50 Hz
MAX_COLUMNS = 20_000  # assumed: a hundred times the widest recording


def check_writable(log: Log, target: str) -> None:
    """InputError for no rows, a sample too large, a hole in the clock, and a column name that no heading can hold."""
    if not len(log):
        raise InputError(f"{target}: the log has no rows, it is not written")
    for name, values in {"time": log.time, **log.signals}.items():
        wrong = np.flatnonzero((np.abs(values) > LARGEST) | (np.isnan(values) if name == "time" else False))
        if len(wrong):
            row = int(wrong[0])
            raise InputError(f"{target}: column {name!r}, row {row + 1}: {values[row]:g}; the log is not written")
    for name in log.columns:
        bare = name.isprintable() and name == name.strip() and not set(name) & set("[]") and name
        if not bare or name == "time":
            raise InputError(f"{target}: {name!r} cannot be the name of a column; the log is not written")


def headings(log: Log) -> list[str]:
    """Headings of time and all columns, in order."""
    return [heading("time", "s"), *(heading(name, log.units[name]) for name in log.columns)]


def log_from_columns(columns: Iterable[tuple[str, np.ndarray]], source: str) -> Log:
    """A log from (heading, values (n,)) pairs: units converted, doubled columns, no time and no rows refused."""
    signals, units = columns_in_si(columns, source)
    if "time" not in signals:
        raise InputError(
            f"{source}: required column 'time [s]' is missing (found {', '.join(signals) or 'no columns'})"
        )
    time = signals.pop("time")
    units.pop("time")
    if not len(time):
        raise InputError(f"{source}: no rows")
    if np.isnan(time).any():
        raise InputError(f"{source}: column 'time', row {int(np.flatnonzero(np.isnan(time))[0]) + 1}: empty")
    return Log(time, signals, units, source)


def check_columns(log: Log, required: Sequence[str], complete: Sequence[str] = ()) -> None:
    """InputError naming a required column that is missing or empty, or a missing sample in a complete one."""
    names = list(dict.fromkeys(name for kind in required for name in log.names(kind)))
    wanted: list[str] = []
    for item in required:
        if item not in KINDS or item in log.signals or item == "time":
            wanted.append(item)
        else:
            wanted += [f"{item}_{name}" for name in names] or [f"{item}_..."]
    for column in wanted:
        if column != "time" and column not in log.signals:
            raise InputError(
                f"{log.label}: required column {column!r} is missing (found time, {', '.join(log.columns)})"
            )
        if np.isnan(log[column]).all():
            raise InputError(f"{log.label}: required column {column!r} is empty")
    for item in complete:
        for column in [item] if item in log.signals else [f"{item}_{name}" for name in log.names(item)]:
            missing = np.flatnonzero(np.isnan(log[column]))
            if len(missing):
                raise InputError(
                    f"{log.label}: column {column!r}, row {int(missing[0]) + 1}: a missing sample is not allowed here"
                )


def check_size(samples: int, source: str) -> None:
    """InputError for a log that would fill the memory."""
    if samples > MAX_SAMPLES:
        raise InputError(f"{source}: {samples} samples, more than {MAX_SAMPLES}; cut it into several logs")
