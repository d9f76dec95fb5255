"""Foreign tables of text: any separator, decimal comma, lists in cells.

Read in this process: no text crashes Python's own reader, and `check_size` bounds its cells before they are split.
"""

import csv
import io
import json
import re
from collections.abc import Callable, Iterator
from functools import cache
from itertools import chain, islice

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.foreign.mapping import Mapped
from exodrake.data.log import MAX_COLUMNS, MAX_SAMPLES, check_size, refuse_doubled

MISSING = ("", "nan", "na", "null", "none", "-")
SEPARATORS = (",", ";", "\t", " ")
LOOK, LINES = 1_000_000, 20  # bytes, and lines in them, by which separator and decimal mark are guessed


def read_text(data: bytes, source: str, mapped: Mapped) -> dict[str, np.ndarray]:
    """The mapped columns of a text file, and those whose cells hold mapped lists."""
    names, rows = _table(data, source, mapped)
    refuse_doubled(names, source)
    wanted = {column.foreign for column in mapped.columns} | {mapped.time}
    holding = wanted | {name.rpartition("[")[0] for name in wanted if name}
    picked = {name: index for index, name in enumerate(names) if name in holding}
    cells: dict[str, list[str]] = {name: [] for name in picked}
    for number, row in enumerate(rows):
        if len(row) != len(names):
            raise InputError(
                f"{source}: row {number + 1} has {len(row)} cells, wanted {len(names)}{_hint(data, mapped)}"
            )
        for name, index in picked.items():
            cells[name].append(row[index].strip())
    columns: dict[str, np.ndarray] = {}
    for name in picked:
        columns |= _parsed(cells[name], name, wanted, source, mapped.decimal)
    for absent in sorted(wanted - set(columns) - {None}, key=str):
        raise InputError(f"{source}: no column {absent!r} (it has {', '.join(names)[:400]}){_hint(data, mapped)}")
    return columns


def _hint(data: bytes, mapped: Mapped) -> str:
    """What a mapping lacks whose separator leaves all cells of the first lines in one."""
    guess = guessed(data)
    marks = {"separator": guess.separator, "decimal": guess.decimal}
    other = [f"{key}: {json.dumps(mark)}" for key, mark in marks.items() if mark != getattr(mapped, key)]
    return f"; the mapping file lacks {' and '.join(other)}" if mapped.separator != guess.separator else ""


def _table(data: bytes, source: str, mapped: Mapped) -> tuple[list[str], Iterator[list[str]]]:
    """Names of the columns, and rows of cells. InputError as `_rows` and `_names`, and for too many cells."""
    check_size(sum(data.count(end) for end in {b"\n", b"\r", mapped.separator.encode()}), source)
    rows = _rows(data, source, mapped)
    first = next(rows, [])
    return _names(first, mapped.heading, source), rows if mapped.heading else chain([first], rows)


def _rows(data: bytes, source: str, mapped: Mapped) -> Iterator[list[str]]:
    """Rows of cells that are not all empty, after the lines to skip."""
    try:
        lines = islice(io.TextIOWrapper(io.BytesIO(data), "utf-8-sig"), mapped.skip, None)
        space = mapped.separator.isspace() and mapped.separator != "\t"
        split = (line.split() for line in lines) if space else csv.reader(lines, delimiter=mapped.separator)
        yield from (row for row in split if any(map(str.strip, row)))
    except UnicodeDecodeError:
        raise InputError(f"{source}: not a text file") from None
    except csv.Error as error:
        raise InputError(f"{source}: not a table of text ({error})") from None


def _parsed(cells: list[str], name: str, wanted: set, source: str, decimal: str) -> dict[str, np.ndarray]:
    """One text column as numbers, several for cells that hold lists, none for text that is not mapped."""
    if name in wanted:
        return {name: np.array([_number(cell, name, row, source, decimal) for row, cell in enumerate(cells)])}
    indices = [item for item in wanted if item and item.startswith(name + "[") and item.endswith("]")]
    lists = [_items(cell) for cell in cells] if indices else []
    columns = {}
    for item in indices:
        index = item[len(name) + 1 : -1]
        at = int(index) if index.isdecimal() and len(index) < 10 else MAX_SAMPLES
        picked = [items[at] if at < len(items) else cell for items, cell in zip(lists, cells, strict=True)]
        columns[item] = np.array([_number(cell, item, row, source, decimal) for row, cell in enumerate(picked)])
    return columns


def _items(cell: str) -> list[str]:
    """The numbers of `[1, 2, 3]`, as text."""
    return [item.strip() for item in cell.strip("[]() ").replace(";", ",").split(",")]


def _names(first: list[str], heading: bool, source: str) -> list[str]:
    """Names of columns by the first row of cells, or their numbers. InputError for no row, and for too many columns."""
    if not first:
        raise InputError(f"{source}: empty file")
    if len(first) > MAX_COLUMNS:
        raise InputError(f"{source}: {len(first)} columns, more than {MAX_COLUMNS}")
    return [cell.strip() for cell in first] if heading else [str(number) for number in range(len(first))]


def _number(cell: str, name: str, row: int, source: str, decimal: str) -> float:
    if cell.lower() in MISSING:
        return np.nan
    if not number_with(decimal)(cell):
        mark = f" with the decimal mark {decimal!r}" if set(cell) & set(".,'") else ""
        raise InputError(f"{source}: column {name!r}, row {row + 1}: {cell[:40]!r} is not a number{mark}")
    return float(cell.replace(decimal, "."))


@cache
def number_with(decimal: str) -> Callable[[str], object]:
    """Test of a cell for a number with this decimal mark; no mark parts thousands, as Python's `1_000` does."""
    digits = rf"(?:[0-9]+(?:{re.escape(decimal)}[0-9]*)?|{re.escape(decimal)}[0-9]+)"
    return re.compile(rf"[-+]?(?:{digits}(?:e[-+]?[0-9]+)?|inf|infinity|nan)", re.IGNORECASE).fullmatch


def guessed(data: bytes) -> Mapped:
    """A mapping of all columns of a text table, by its first lines.

    Separator and decimal mark are those by which most cells are numbers, in rows as long as the first; a first line of
    numbers alone is no heading.
    """
    text = data[:LOOK].decode("utf-8-sig", "replace")
    lines = [line for line in text.splitlines() if line.strip()][:LINES]

    def cells(line: str, separator: str) -> list[str]:
        try:
            found = line.split() if separator == " " else next(csv.reader([line], delimiter=separator), [])
        except csv.Error:
            found = [line]
        return [cell.strip() for cell in found]

    def fit(marks: tuple[str, str]) -> int:
        first, *rows = [cells(line, marks[0]) for line in lines] or [[]]
        whole = [len(row) == len(first) and _is_number(cell, marks[1]) for row in rows or [first] for cell in row]
        return 2 * sum(whole) - len(whole)

    separator, decimal = max(((s, d) for d in ".," for s in SEPARATORS if s != d), key=fit)
    heading = not all(_is_number(cell, decimal) for line in lines[:1] for cell in cells(line, separator))
    return Mapped((), separator=separator, decimal=decimal, heading=heading)


def read_all(data: bytes, source: str) -> dict[str, np.ndarray]:
    """All columns of numbers of a text table; a column of lists as `name[0]`, `name[1]` ..."""
    guess = guessed(data)
    names, rows = _table(data, source, guess)
    columns: dict[str, np.ndarray] = {}
    body = [row for row in rows if len(row) == len(names)]
    for k, name in enumerate(names):
        cells = [row[k].strip() for row in body]
        parts = {name: cells}
        if cells and cells[0].startswith(("[", "(")):
            lists = [_items(cell) for cell in cells]
            count = min(map(len, lists))
            parts = (
                {f"{name}[{i}]": [items[i] for items in lists] for i in range(count)} if count <= MAX_COLUMNS else {}
            )
        for part, found in parts.items():
            if all(_is_number(cell, guess.decimal) for cell in found):
                columns[part] = np.array([_number(cell, part, 0, source, guess.decimal) for cell in found])
    return columns


def _is_number(cell: str, decimal: str) -> bool:
    """Whether a cell holds a number, or says that one is missing."""
    return bool(number_with(decimal)(cell)) or cell.lower() in MISSING
