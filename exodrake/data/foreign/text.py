"""Foreign tables of text: any separator, decimal comma, lists in cells."""

import csv
import io
from collections.abc import Iterator
from itertools import chain, islice

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.columns import check_size
from exodrake.data.foreign.mapping import Mapped

MISSING = ("", "nan", "na", "null", "none", "-")
SEPARATORS = (",", ";", "\t", " ")


def read_text(data: bytes, source: str, mapped: Mapped) -> dict[str, np.ndarray]:
    """The mapped columns of a text file, and those whose cells hold mapped lists."""
    check_size(sum(data.count(end) for end in (b"\n", b"\r", mapped.separator.encode())), source)
    rows = _rows(data, source, mapped)
    first = next(rows, None)
    if first is None:
        raise InputError(f"{source}: empty file")
    names = [cell.strip() for cell in first] if mapped.heading else [str(number) for number in range(len(first))]
    if len(set(names)) < len(names):
        raise InputError(f"{source}: column {next(name for name in names if names.count(name) > 1)!r} comes twice")
    wanted = {column.foreign for column in mapped.columns} | {mapped.time}
    holding = wanted | {name.rpartition("[")[0] for name in wanted if name}
    picked = {name: index for index, name in enumerate(names) if name in holding}
    cells: dict[str, list[str]] = {name: [] for name in picked}
    for number, row in enumerate(rows if mapped.heading else chain([first], rows)):
        if len(row) != len(names):
            raise InputError(f"{source}: row {number + 1} has {len(row)} cells, wanted {len(names)}")
        for name, index in picked.items():
            cells[name].append(row[index].strip())
    columns: dict[str, np.ndarray] = {}
    for name in picked:
        columns |= _parsed(cells[name], name, wanted, source, mapped.decimal)
    for absent in sorted(wanted - set(columns) - {None}, key=str):
        raise InputError(f"{source}: no column {absent!r} (it has {', '.join(names)[:400]})")
    return columns


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
    columns = {}
    for item in indices:
        index = item[len(name) + 1 : -1]
        picked = [_element(cell, index) for cell in cells]
        columns[item] = np.array([_number(cell, item, row, source, decimal) for row, cell in enumerate(picked)])
    return columns


def _element(cell: str, index: str) -> str:
    """The index-th number of `[1, 2, 3]`, as text; the whole cell if there is none such, for the message."""
    items = cell.strip("[]() ").replace(";", ",").split(",")
    return items[int(index)].strip() if index.isdecimal() and len(index) < 10 and int(index) < len(items) else cell


def _number(cell: str, name: str, row: int, source: str, decimal: str) -> float:
    if cell.lower() in MISSING:
        return np.nan
    try:
        return float(cell.replace(decimal, ".") if decimal != "." else cell)
    except ValueError:
        raise InputError(f"{source}: column {name!r}, row {row + 1}: {cell[:40]!r} is not a number") from None


def guessed(data: bytes, source: str) -> Mapped:
    """A mapping of all columns of a text table: the separator of its first line, no heading if that holds numbers."""
    try:
        first = data[: data.find(b"\n") if b"\n" in data else None].decode("utf-8-sig").strip()
    except UnicodeDecodeError:
        raise InputError(f"{source}: not a text file") from None
    separator = max(SEPARATORS, key=lambda mark: len(first.split(mark)))
    cells = [cell.strip() for cell in first.split(separator)]
    decimal = "," if separator != "," and b"," in data[:2000] and b"." not in data[:2000] else "."
    heading = not all(_is_number(cell, decimal) for cell in cells)
    return Mapped((), separator=separator, decimal=decimal, heading=heading)


def read_all(data: bytes, source: str) -> dict[str, np.ndarray]:
    """All columns of numbers of a text table; a column of lists as `name[0]`, `name[1]` ..."""
    guess = guessed(data, source)
    rows = list(_rows(data, source, guess))
    names = [cell.strip() for cell in rows[0]] if guess.heading else [str(k) for k in range(len(rows[0]))]
    columns: dict[str, np.ndarray] = {}
    body = [row for row in rows[guess.heading :] if len(row) == len(names)]
    for k, name in enumerate(names):
        cells = [row[k].strip() for row in body]
        if cells and cells[0].startswith(("[", "(")):
            count = len(cells[0].strip("[]() ").replace(";", ",").split(","))
            parts = {f"{name}[{i}]": [_element(cell, str(i)) for cell in cells] for i in range(count)}
        else:
            parts = {name: cells}
        for part, found in parts.items():
            if all(_is_number(cell, guess.decimal) for cell in found):
                columns[part] = np.array([_number(cell, part, 0, source, guess.decimal) for cell in found])
    return columns


def _is_number(cell: str, decimal: str) -> bool:
    """Whether a cell holds a number, or says that one is missing."""
    try:
        float(cell.replace(decimal, "."))
    except ValueError:
        return cell.lower() in MISSING
    return True
