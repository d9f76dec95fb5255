"""CSV: a heading row with units in brackets, one row per frame, an empty cell where a sample is missing."""

import csv
import gzip
import io
import zlib

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import MAX_BYTES, limit_size
from exodrake.data.log import Log, headings, log_from_columns
from exodrake.data.text import read_text

ENDINGS = (".csv.gz", ".csv")


def read(data: bytes, source: str) -> Log:
    """Parse a CSV log. InputError names file, column and row (row 1 is the first below the heading)."""
    data = unpack(data, source) if source.lower().endswith(".gz") else data
    return log_from_columns(read_text(data, source).items(), source)


def read_cells(data: bytes, source: str) -> tuple[list[str], np.ndarray]:
    """Headings as they stand, and values (rows, columns), NaN for empty cells. InputError for text or a ragged row."""
    columns = read_text(data, source)
    return list(columns), np.column_stack([*columns.values()])


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
