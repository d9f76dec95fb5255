"""Logs read from and written to files, whose ending says the format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError, argument
from exodrake.core.files import is_file, is_folder, read_bytes, refuse_special, write_bytes
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
