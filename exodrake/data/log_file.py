"""Logs read from and written to files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    pass
from exodrake.data.log import REQUIRED, Log, check_clock


def read_log(path: str | Path, required: Sequence[str] = REQUIRED, complete: Sequence[str] = ()) -> Log:
    """Read a log in SI from .csv, .csv.gz, .npz, .parquet, .mcap or .mat.

    required: columns, or kinds (then every name found under one required kind must be there under all of them); `()`
    takes any log. complete: columns or kinds in which no sample may be missing. InputError names file, column and row
    for an unknown or unsuitable unit, a missing, doubled or empty column, text in a cell, a ragged row, an empty file
    and a clock that does not increase (see `exodrake.data.clock.regularise` for those).
    """
    from exodrake.data.formats.table import check_columns, read_table

    log = read_table(path)
    check_columns(log, required, complete)
    check_clock(log)
    return log


def write_log(log: Log, path: str | Path) -> None:
    """Write a log by the file's ending, in SI, whole or not at all; `read_log` gives it back to the last bit."""
    from exodrake.data.formats.table import write_table

    write_table(log, path)
