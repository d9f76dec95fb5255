"""Tables of numbers as text: logs in CSV, and foreign ones with another separator, decimal mark or lists in cells.

A log has a heading row with units in brackets, a row per frame, and an empty cell where a sample is missing. A foreign
cell `[1, 2, 3]` makes columns `name[0]`, `name[1]` ...; a row without content is none.
"""

import csv
import gzip
import io
import json
import zlib
from array import array
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice
from math import nan

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import MAX_BYTES, limit_size
from exodrake.data.log import MAX_COLUMNS, Log, check_size, headings, log_from_columns, refuse_doubled

ENDINGS = (".csv.gz", ".csv")
MISSING = ("", "nan", "na", "null", "none", "-")
SEPARATORS = (",", ";", "\t", " ")
LOOK, LINES = 1_000_000, 20  # bytes, and lines in them, by which separator and decimal mark are guessed


@dataclass(frozen=True, kw_only=True)
class TextLayout:
    """Layout of a text table: separator of cells, decimal mark, lines before the heading, and whether there is one."""

    separator: str = ","
    decimal: str = "."
    skip: int = 0
    heading: bool = True


LOG = TextLayout()


def read(data: bytes, source: str) -> Log:
    """Parse a CSV log. InputError names file, column and row (row 1 is the first below the heading)."""
    data = unpack(data, source) if source.lower().endswith(".gz") else data
    return log_from_columns(read_text(data, source).items(), source)


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


def split_rows(data: bytes, source: str, layout: TextLayout = LOG) -> Iterator[list[str]]:
    """Rows of cells that are not all empty, after the lines to skip."""
    try:
        lines = islice(io.TextIOWrapper(io.BytesIO(data), "utf-8-sig", newline=""), layout.skip, None)
        blanks = layout.separator.isspace() and layout.separator != "\t"
        rows = (line.split() for line in lines) if blanks else csv.reader(lines, delimiter=layout.separator)
        yield from (row for row in rows if any(map(str.strip, row)))
    except UnicodeDecodeError:
        raise InputError(f"{source}: not a text file") from None
    except csv.Error as error:
        raise InputError(f"{source}: not a table of text ({error})") from None


def read_text(
    data: bytes, source: str, layout: TextLayout = LOG, wanted: Collection[str] = (), strict: bool = True,
    before: int = 0,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Columns (n,) of numbers by name, the wanted ones or all, NaN where a cell is empty.

    InputError names column and row of what is no number: `before` + 1 is the first below the heading. If not `strict`,
    a row of another length is left out, and so is a column with text.
    """
    check_size(sum(data.count(end) for end in {b"\n", b"\r", layout.separator.encode()}), source)
    rows = split_rows(data, source, layout)
    if not (first := next(rows, [])):
        raise InputError(f"{source}: empty file")
    if len(first) > MAX_COLUMNS:
        raise InputError(f"{source}: {len(first)} columns, more than {MAX_COLUMNS}")
    names = [cell.strip() for cell in first] if layout.heading else [str(number) for number in range(len(first))]
    refuse_doubled(names, source)
    second = next(rows, []) if layout.heading else first
    places: dict[str, tuple[int, int | None]] = {name: (k, None) for k, name in enumerate(names)}
    for k, (name, cell) in enumerate(zip(names, second)):  # items of lists, as many as the first one has
        if any(one.startswith(f"{name}[") for one in wanted) or (not wanted and cell.strip().startswith(("[", "("))):
            for i in range(min(len(split_list(cell)), MAX_COLUMNS)):
                places.setdefault(f"{name}[{i}]", (k, i))
    for absent in sorted(set(wanted) - set(places)):
        there = ", ".join(names)[:400]
        raise InputError(f"{source}: no column {absent!r} (it has {there}){hint_at_layout(data, layout)}")
    chosen, texts, values = {name: places[name] for name in wanted or places}, set[str](), array("d")
    check_size(len(chosen) * data.count(b"\n"), source)
    lists = {k for k, i in chosen.values() if i is not None}
    body = data[max(data.find(b"\n"), 0) if layout.heading else 0 :]
    simple = layout.decimal == "." and body.isascii() and b"_" not in body  # else float() may take 1_000
    for number, row in enumerate(chain([second] if second else [], rows), before + 1):
        if len(row) != len(names):
            if strict:
                length = f"row {number} has {len(row)} cells, wanted {len(names)}"
                raise InputError(f"{source}: {length}{hint_at_layout(data, layout)}")
            continue
        items = {k: split_list(row[k]) for k in lists}
        cells = [row[k] if i is None or i >= len(items[k]) else items[k][i] for k, i in chosen.values()]
        try:
            values.extend([float(c) if c else nan for c in cells] if simple else [to_number(c, layout) for c in cells])
        except ValueError:
            for name, cell in zip(chosen, cells):
                try:
                    values.append(to_number(cell, layout))
                except ValueError:
                    values.append(nan)
                    texts.add(name)
                    if strict:
                        mark = f" with the decimal mark {layout.decimal!r} (`decimal` of a mapping)"
                        hint = hint_at_layout(data, layout) or (mark if set(cell) & set(".,'") else "")
                        where = f"{source}: column {name!r}, row {number}: {cell.strip()[:40]!r}"
                        raise InputError(f"{where} is not a number{hint}") from None
    table = np.array(values).reshape(-1, len(chosen)).T
    return {name: column for name, column in zip(chosen, table, strict=True) if name not in texts}


def split_list(cell: str) -> list[str]:
    """The items of a cell that holds a list."""
    return cell.strip("[]() ").replace(";", ",").split(",")


def to_number(cell: str, layout: TextLayout) -> float:
    """The number in a cell, NaN where it says that one is missing. ValueError for text and for marks in a number."""
    cell = cell.strip()
    if cell.lower() in MISSING:
        return nan
    if "_" in cell or not cell.isascii() or (layout.decimal != "." and "." in cell):
        raise ValueError(cell)
    return float(cell.replace(layout.decimal, "."))


def is_number(cell: str, layout: TextLayout) -> bool:
    """Whether a cell holds a number, or says that one is missing."""
    try:
        to_number(cell, layout)
    except ValueError:
        return False
    return True


def hint_at_layout(data: bytes, layout: TextLayout) -> str:
    """What a mapping file must say where the separator leaves all cells of the first lines in one."""
    guess = guess_layout(data)
    other = [key for key in ("separator", "decimal") if getattr(guess, key) != getattr(layout, key)]
    wanted = " and ".join(f"{key}: {json.dumps(getattr(guess, key))}" for key in other)
    parts = [mark.separator.encode() in data[:LOOK].partition(b"\n")[0] for mark in (guess, layout)]
    return f"; a mapping file must say {wanted} (`exodrake import`)" if parts == [True, False] else ""


def guess_layout(data: bytes) -> TextLayout:
    """The layout of a text table: separator and decimal mark by which most cells of its first lines are numbers."""
    lines = [line for line in data[:LOOK].splitlines(keepends=True) if line.strip()][:LINES]

    def split(layout: TextLayout) -> list[list[str]]:
        try:
            return list(split_rows(b"".join(lines), "", layout)) or [[]]
        except InputError:
            return [[]]

    def fit(layout: TextLayout) -> int:
        first, *rows = split(layout)
        whole = [len(row) == len(first) and is_number(cell, layout) for row in rows or [first] for cell in row]
        return 2 * sum(whole) - len(whole)

    layouts = [TextLayout(separator=s, decimal=d) for d in ".," for s in SEPARATORS if s != d]
    found = max(layouts, key=fit)
    return replace(found, heading=not all(is_number(cell, found) for cell in split(found)[0]))
