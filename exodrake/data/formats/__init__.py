"""Files of logs: a table of endings with their readers and writers. `.csv.gz` is gzipped CSV.

A format is a module here, or in `data/formats` of a plugin, with `ENDINGS`, `read(data: bytes, source: str) -> Log` and
`write(log: Log) -> bytes`; formats differ in how they hold a heading `name [unit]` and a missing sample.
"""

import gzip
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core import plugins
from exodrake.core.errors import InputError, argument
from exodrake.core.files import is_file, is_folder, read_bytes, refuse_special, write_bytes
from exodrake.core.processes import in_child
from exodrake.data.log import CHANGED, MODEL, Log, check_clock, check_columns, headings, log_from_columns

plugins.extend(__path__, "data/formats")
GZIPPED = ".csv.gz"
MARK = "simulated"  # column of a file, of any format, that marks what exodrake simulated


@cache
def formats() -> dict[str, Any]:
    """Modules of the formats by ending; where two claim an ending, the first by name has it."""
    found: dict[str, Any] = {}
    for name in plugins.module_names(__path__):
        with plugins.shown_errors():
            module = import_module(f"{__name__}.{name}")
        for ending in module.ENDINGS:
            found.setdefault(ending, module)
    return found


def ending(path: str | Path) -> str | None:
    """The known ending of a file name, longest first, or None."""
    name = Path(path).name.lower()
    return next((known for known in sorted(formats(), key=len, reverse=True) if name.endswith(known)), None)


def stem(path: str | Path) -> str:
    """A file's name without folder and ending: `sweeps_1` of `logs/sweeps_1.csv.gz`."""
    name = Path(path).name
    return name[: -len(ending(name) or "")] if ending(name) else Path(name).stem


def find_format(path: str | Path) -> Any:
    """The module of a file's format; InputError with all endings for an unknown one."""
    known = ending(path)
    if known is None:
        raise InputError(f"{path}: ending is none of {', '.join(formats())}")
    return formats()[known]


def read_apart[T](reader: Callable[[bytes, str], T], data: bytes, source: str) -> T:
    """What a reader makes of a file, in the child process. InputError for a damaged file."""
    return in_child(read_whole, reader, data, source, source=source, size=len(data))


def read_whole(reader: Callable[[bytes, str], Any], data: bytes, source: str) -> Any:
    """`read_apart` in this process."""
    try:
        return reader(data, source)
    except InputError:
        raise
    except Exception as error:  # a parser raises whatever damaged bytes lead it to
        kind = Path(source.removesuffix(".gz")).suffix[1:].upper()
        raise InputError(f"{source}: not a whole {kind} file ({type(error).__name__})") from None


def read_log(path: str | Path, required: Sequence[str] = (), complete: Sequence[str] = ()) -> Log:
    """Reads a log in SI from .csv, .csv.gz, .npz, .parquet, .mcap, .mat or a plugin's format.

    Args:
        path: the file.
        required: columns, or kinds (then every channel found under one of them must be there under all of them).
        complete: columns or kinds in which no sample may be missing.

    Raises:
        InputError: naming file, column and row, for an unknown or unsuitable unit, a missing, doubled or empty column,
            text in a cell, a ragged row, an empty file and a clock that does not increase (`regularise` mends that).

    Examples:
        >>> import exodrake as exo
        >>> exo.write_log(exo.simulate(exo.load_robot(), "caging"), "mine.csv")
        >>> read_log("mine.csv")
        Log(mine.csv: 275 rows, 0 to 5.48 s; tension_ref, tension, stroke, speed_cmd, angle)
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
    log = find_format(path).read(read_bytes(path), str(path))
    mark = log.signals.get(MARK, np.zeros(0))
    if not len(mark) or mark[0] not in (MODEL, CHANGED) or np.any(mark != mark[0]):
        return log  # a column of this name that holds anything else stays a column
    return replace(log.only([name for name in log.columns if name != MARK]), simulated=int(mark[0]))


def write_log(log: Log, path: str | Path) -> None:
    """Writes a log in SI, whole or not at all; `read_log` gives it back to the last bit. InputError as `log_bytes`.

    Examples:
        >>> import exodrake as exo
        >>> write_log(exo.simulate(exo.load_robot(), "caging"), "mine.npz")
    """
    write_bytes(path, log_bytes(argument("log", log, Log), path))


def log_bytes(log: Log, path: str | Path) -> bytes:
    """Content of a log's file. InputError for an unknown ending, and for what would be refused when it is read."""
    write = find_format(path).write
    try:
        columns = log_from_columns(zip(headings(log), [log.time, *log.signals.values()]), str(path)).columns
    except InputError as problem:
        raise InputError(f"{problem}; the log is not written") from None
    if columns != log.columns:
        raise InputError(f"{path}: a column's name begins or ends with a blank; the log is not written")
    marked = log.with_signals({MARK: np.full(len(log), float(log.simulated))}, {MARK: "-"}) if log.simulated else log
    data = write(marked)  # gzipped without a time stamp, so that the same log gives the same bytes
    return gzip.compress(data, compresslevel=6, mtime=0) if ending(path) == GZIPPED else data
