"""CSV: a heading row with units in brackets, one row per frame, an empty cell where a sample is missing."""

import csv
import gzip
import io
import zlib
from array import array
from collections.abc import Iterator
from math import nan

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import MAX_BYTES, limit_size
from exodrake.data.log import Log, check_size, headings, log_from_columns, refuse_separator

ENDINGS = (".csv.gz", ".csv")


def read(data: bytes, source: str) -> Log:
    """Parse a CSV log. InputError names file, column and row (row 1 is the first below the heading)."""
    names, values = read_cells(unpack(data, source) if source.lower().endswith(".gz") else data, source)
    return log_from_columns(zip(names, values.T, strict=True), source)


def read_cells(data: bytes, source: str) -> tuple[list[str], np.ndarray]:
    """Headings as they stand, and values (rows, columns), NaN for empty cells. InputError for text or a ragged row."""
    check_size(sum(data.count(end) for end in (b",", b"\n", b"\r")), source)
    rows = _rows(data, source)
    names = [name.strip() for name in next(rows, [])]
    if not any(names):
        raise InputError(f"{source}: empty file")
    refuse_separator(names, source)
    values = array("d")
    for number, row in enumerate(rows, 1):
        where = f"row {number} (line {number + 1})"
        if len(row) != len(names):
            raise InputError(f"{source}: {where} has {len(row)} cells, the heading has {len(names)}")
        try:
            values.extend([float(cell) if cell else nan for cell in row])
        except ValueError:  # of blanks, or of no number
            for cell, name in zip(row, names):
                try:
                    values.append(float(cell) if cell.strip() else nan)
                except ValueError:
                    shown = cell if len(cell) <= 40 else cell[:37] + "..."
                    raise InputError(f"{source}: column {name!r}, {where}: {shown!r} is not a number") from None
    return names, np.array(values).reshape(-1, len(names))


def _rows(data: bytes, source: str) -> Iterator[list[str]]:
    """Rows of cells; empty lines at the end are no rows."""
    try:
        underscores = data.find(b"_", data.find(b"\n")) >= 0  # float() takes 1_000, a log must not
        text = io.TextIOWrapper(io.BytesIO(data), "utf-8-sig", newline="")
        empty: list[list[str]] = []
        for number, row in enumerate(csv.reader(text, strict=True)):
            if not any(cell.strip() for cell in row):
                empty.append(row)
                continue
            yield from empty
            empty.clear()
            yield [cell.replace("_", "·") for cell in row] if underscores and number else row
    except UnicodeDecodeError:
        raise InputError(f"{source}: not a text file") from None
    except csv.Error as error:
        raise InputError(f"{source}: not a CSV file ({error})") from None


def write(log: Log) -> bytes:
    """The log as CSV in SI. Shortest digits that read back to the same bits; NaN becomes an empty cell."""
    table = np.column_stack([log.time, *log.signals.values()]).tolist()
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(headings(log))
    writer.writerows([["" if cell != cell else repr(cell) for cell in row] for row in table])
    return stream.getvalue().encode()


def unpack(data: bytes, source: str) -> bytes:
    """Gunzipped bytes. InputError for no whole gzip file, and for more bytes than a file may have."""
    try:
        with gzip.open(io.BytesIO(data)) as stream:
            return limit_size(stream.read(MAX_BYTES + 1), source)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{source}: not a whole gzip file ({error})") from None
