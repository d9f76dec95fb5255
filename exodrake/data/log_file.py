"""Logs read from and written to files, whose ending says the format; and clock faults of recorded logs.

A fault of the clock is mended where the answer is certain, and refused by name where it is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError, argument
from exodrake.core.files import is_file, is_folder, read_bytes, refuse_special, write_bytes
from exodrake.core.units import to_si
from exodrake.data.formats import format_of
from exodrake.data.log import CHANGED, MODEL, Log, check_clock, check_columns, check_writable


def read_log(path: str | Path, required: Sequence[str] = (), complete: Sequence[str] = ()) -> Log:
    """Reads a log in SI from .csv, .csv.gz, .npz, .parquet, .mcap, .mat or a plugin's format.

    Args:
        path: the file.
        required: columns, or kinds (then every channel found under one of them must be there under all of them).
        complete: columns or kinds in which no sample may be missing.

    Raises:
        InputError: naming file, column and row, for an unknown or unsuitable unit, a missing, doubled or empty column,
            text in a cell, a ragged row, an empty file and a clock that does not increase (`clock.regularise` mends
            that).
    """
    log = read_table(path)
    check_columns(log, required, complete)
    check_clock(log)
    return log


def read_table(path: str | Path) -> Log:
    """A log whose required columns and clock are not checked."""
    refuse_special(path)
    if not is_file(path):
        raise InputError(f"{path}: {'a folder, wanted a log' if is_folder(path) else 'no such file'}")
    return without_mark(format_of(path).read(read_bytes(path), str(path)))


def write_log(log: Log, path: str | Path) -> None:
    """Writes a log in SI, whole or not at all; `read_log` gives it back to the last bit. InputError as `log_bytes`."""
    write_bytes(path, log_bytes(argument("log", log, Log), path))


def log_bytes(log: Log, path: str | Path) -> bytes:
    """Content of a log's file.

    Raises:
        InputError: for an unknown ending, and for what no file would give back: no rows, a sample that is infinite or
            larger than any signal, a hole in the clock, a name that no heading can hold.
    """
    module = format_of(path)
    check_writable(log, str(path))
    return module.write(with_mark(log))


MARK = "simulated"  # column of a file that marks what exodrake simulated, of any format


def with_mark(log: Log) -> Log:
    """The log as a file holds it: of a simulated one, the mark as its last column."""
    return log.with_signals({MARK: np.full(len(log), float(log.simulated))}, {MARK: "-"}) if log.simulated else log


def without_mark(log: Log) -> Log:
    """The log of a file, the mark as its field; a column of this name that holds anything else stays a column."""
    values = log.signals.get(MARK)
    if values is None or not len(values) or values[0] not in (MODEL, CHANGED) or np.any(values != values[0]):
        return log
    return replace(log.only([name for name in log.columns if name != MARK]), simulated=int(values[0]))


LONGEST = 100  # rows to fill per row recorded; beyond, a clock has jumped or its unit is wrong
SMALLER = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}  # units that a clock may count in
RATE = 3e-3  # by which a clock may run fast or slow: assumed; those of computers keep to a tenth of it
STRETCH = 250  # rows over which a rate is measured; the shortest, so that jitter of a third of a frame is none
EXACT = 1e-6  # s; frame times closer to the grid than this are on it (files often round time to microseconds)


def regularise(log: Log, period: float = 0.02) -> tuple[Log, list[str]]:
    """One row per frame of `period` [s], and notes on what was changed (empty, and the same log, if nothing was).

    Rows that repeat the one before, time included, are dropped. Frames that are absent become rows of NaN. Times off
    the grid are set on it, since row n is frame n. InputError, naming the row, for a clock that steps backwards, the
    same time with other values, and rows that come faster than the frame; naming the unit that a clock seems to have,
    and the frame that it seems to count where that is another one.
    """
    if not (np.isfinite(period) and period > 0):
        raise InputError(f"frame period {period!r} s: wanted a positive number")
    repeated = _repeated(argument("log", log, Log))
    _refuse_backward_steps(log, repeated)
    single = log.rows(~repeated) if repeated.any() else log
    _refuse_other_unit(single, period)
    frames = _frame_numbers(single, period)
    found = other_rate(single.time, frames, period)
    if found is not None:
        start, step = found
        apart = step * float(np.median(np.diff(frames)))
        raise InputError(
            f"{single.label}: from {start:g} s on its rows are {apart * 1e3:.4g} ms apart, no multiple of the frame of "
            f"{period * 1e3:g} ms: its clock or the `period` is wrong; `exodrake import` puts another rate on frames"
        )
    notes = [_repeats_note(log, repeated)] if repeated.any() else []
    grid = single.time[0] + period * np.arange(frames[-1] + 1) if len(single) else single.time
    deviation = float(np.max(np.abs(single.time - grid[frames]))) if len(single) else 0.0
    if deviation > max(EXACT, period * 1e-3):
        notes.append(
            f"{log.label}: frame times up to {deviation * 1e3:.3g} ms off the {period * 1e3:g} ms grid, set on it"
        )
    absent = len(grid) - len(single)
    if not absent:
        clean = single if deviation <= EXACT else Log(grid, single.signals, single.units, single.source)
        return clean, notes
    notes.append(f"{log.label}: {_missing(frames, grid, absent)}, left empty")
    return _spread(single, frames, grid, deviation), notes


def _repeated(log: Log) -> np.ndarray:
    """Mask (n,) of rows equal to the row before in time and in every column."""
    table = np.column_stack([log.time, *log.signals.values()])
    same = (table[1:] == table[:-1]) | (np.isnan(table[1:]) & np.isnan(table[:-1]))
    return np.concatenate([np.zeros(min(1, len(log)), dtype=bool), same.all(axis=1)])


def _repeats_note(log: Log, repeated: np.ndarray) -> str:
    row = int(np.flatnonzero(repeated)[0])
    return (
        f"{log.label}: {int(repeated.sum())} repeated rows dropped, the first is row {row + 1} at {log.time[row]:g} s"
    )


def _refuse_backward_steps(log: Log, repeated: np.ndarray) -> None:
    wrong = np.flatnonzero(~(np.diff(log.time) > 0) & ~repeated[1:])
    if not len(wrong):
        return
    row = int(wrong[0])
    here, after = log.time[row], log.time[row + 1]
    fault = "the same time with other values" if here == after else f"the clock steps backwards by {here - after:.6g} s"
    raise InputError(f"{log.label}: at row {row + 2}, {after:g} s after {here:g} s: {fault}; cut the log there")


def _refuse_other_unit(log: Log, period: float) -> None:
    """InputError for a clock most steps of which are so long that its unit is a smaller one than the second.

    The unit is the one in which the median step is nearest to `period` [s], by ratio.
    """
    if len(log) < 2:
        return
    step = float(np.quantile(np.diff(log.time), 0.5, method="lower"))
    if step > LONGEST * period:
        unit = min(SMALLER, key=lambda unit: abs(np.log(to_si(step, unit) / period)))
        raise InputError(
            f"{log.label}: column 'time' looks like {SMALLER[unit]}, not seconds: its rows are {step:g} apart, a frame "
            f"is {period:g} s; say 'time [{unit}]'"
        )


def _frame_numbers(log: Log, period: float) -> np.ndarray:
    """Frame number (n,) of each row, 0 first.

    Steps are rounded one by one and not from the start, so that a clock 0.1 % fast does not lose a frame in a minute.
    """
    gaps = np.diff(log.time)
    steps = np.rint(gaps / period)
    fast = np.flatnonzero(steps < 1)
    if len(fast):
        at = int(fast[0])
        raise InputError(
            f"{log.label}: two rows {gaps[at]:.3g} s apart at {log.time[at]:g} s, but a frame is {period:g} s"
        )
    if steps.sum() > LONGEST * (len(log) + LONGEST):
        at = int(np.argmax(gaps))
        raise InputError(
            f"{log.label}: a gap of {gaps[at]:.6g} s at {log.time[at]:g} s is no missing frame; cut the log there"
        )
    steps = steps.astype(int)
    return np.concatenate([[0], np.cumsum(steps)]) if len(log) else np.zeros(0, dtype=int)


def other_rate(time: np.ndarray, frames: np.ndarray, period: float) -> tuple[float, float] | None:
    """Time from which a clock runs at another rate, and its frame there; None if it does not.

    The rate is that of the straight line through some rows. It counts where it takes them half a frame away, beyond
    which they lie at another frame.

    Args:
        time: (n,) of the rows [s], increasing.
        frames: (n,) their frame numbers.
        period: of a frame [s].
    """
    for rows in np.array_split(np.arange(len(time)), max(1, len(time) // STRETCH)):
        span = float(frames[rows[-1]] - frames[rows[0]]) if len(rows) > 2 else 0.0
        if span:
            numbers = frames[rows] - frames[rows].mean()
            off = float(numbers @ (time[rows] - time[rows].mean()) / (numbers @ numbers)) / period - 1.0
            if abs(off) > RATE and abs(off) * span > 0.5:
                return float(time[rows[0]]), period * (1.0 + off)
    return None


def frame_of(log: Log) -> float:
    """Frame that a log's clock counts [s]: its median step, or the mean one where stamps are rounded.

    InputError for a log of fewer than two rows.
    """
    step = log.dt
    found = other_rate(log.time, np.concatenate([[0], np.cumsum(np.rint(np.diff(log.time) / step))]), step)
    return step if found is None else found[1]


def _missing(frames: np.ndarray, grid: np.ndarray, absent: int) -> str:
    """`3 missing frames, the first at 1.24 s (longest gap 2)`."""
    steps = np.diff(frames)
    first = int(frames[np.flatnonzero(steps > 1)[0]]) + 1
    return f"{absent} missing frames, the first at {grid[first]:g} s (longest gap {int(steps.max()) - 1} frames)"


def _spread(log: Log, frames: np.ndarray, grid: np.ndarray, deviation: float) -> Log:
    """Rows of the log at their frames, NaN elsewhere. Times that were on the grid keep their bits."""
    time = grid.copy()
    if deviation <= EXACT:
        time[frames] = log.time
    signals = {}
    for name, values in log.signals.items():
        signals[name] = np.full(len(grid), np.nan)
        signals[name][frames] = values
    return Log(time, signals, log.units, log.source)
