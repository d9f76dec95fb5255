"""CSV: a heading row with units in brackets, one row per frame, an empty cell where a sample is missing."""

import csv
import io
from math import nan

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.columns import headings, log_from_columns
from exodrake.data.log import Log

ENDINGS = (".csv",)


def read(data: bytes, source: str) -> Log:
    """Parse a CSV log. InputError names file, column and row (row 1 is the first below the heading)."""
    names, values = read_cells(data, source)
    return log_from_columns(zip(names, values.T, strict=True), source)


def read_cells(data: bytes, source: str) -> tuple[list[str], np.ndarray]:
    """Headings as they stand, and values (rows, columns), NaN for empty cells. InputError for text or a ragged row."""
    rows = _rows(data, source)
    if not rows or not any(cell.strip() for cell in rows[0]):
        raise InputError(f"{source}: empty file")
    names = [name.strip() for name in rows[0]]
    if len(names) == 1 and ";" in names[0]:
        raise InputError(f"{source}: cells are separated by ';', wanted ','")
    values = np.empty((len(rows) - 1, len(names)))
    for number, row in enumerate(rows[1:]):
        if len(row) != len(names):
            raise InputError(
                f"{source}: row {number + 1} (line {number + 2}) has {len(row)} cells, the heading has {len(names)}"
            )
        try:
            values[number] = [float(cell) for cell in row]
        except ValueError:
            values[number] = [_number(cell, name, number, source) for cell, name in zip(row, names, strict=True)]
    return names, values


def write(log: Log) -> bytes:
    """The log as CSV in SI. Shortest digits that read back to the same bits; NaN becomes an empty cell."""
    table = np.column_stack([log.time, *log.signals.values()]).tolist()
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(headings(log))
    writer.writerows([["" if cell != cell else repr(cell) for cell in row] for row in table])
    return stream.getvalue().encode()


def _rows(data: bytes, source: str) -> list[list[str]]:
    try:
        text = data.decode("utf-8-sig")
        if "_" in text[text.find("\n") :]:  # float() takes 1_000, a log must not
            return [[cell.replace("_", "·") for cell in row] if n else row for n, row in enumerate(_split(text))]
        return _split(text)
    except UnicodeDecodeError as error:
        raise InputError(f"{source}: not a text file (byte {error.start})") from None
    except csv.Error as error:
        raise InputError(f"{source}: not a CSV file ({error})") from None


def _split(text: str) -> list[list[str]]:
    """Rows of cells; empty lines at the end are no rows."""
    rows = list(csv.reader(io.StringIO(text, newline=""), strict=True))
    while rows and not any(cell.strip() for cell in rows[-1]):
        rows.pop()
    return rows


def _number(cell: str, name: str, number: int, source: str) -> float:
    if not cell.strip():
        return nan
    try:
        return float(cell)
    except ValueError:
        shown = cell if len(cell) <= 40 else cell[:37] + "..."
        raise InputError(
            f"{source}: column {name!r}, row {number + 1} (line {number + 2}): {shown!r} is not a number"
        ) from None
