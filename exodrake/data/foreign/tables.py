"""Columns of foreign tables by name: text, MAT, HDF5, JSON, NPY, NPZ, Parquet, and MCAP that is a log of ours.

A cell `[1, 2, 3]`, and a matrix, make columns `name[0]`, `name[1]` ...; a field of a struct or group is `outer.inner`.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.child import in_child
from exodrake.core.errors import InputError
from exodrake.core.json_file import parse_json
from exodrake.data.foreign.mapping import Mapped
from exodrake.data.formats import csv_gz, mat, mcap, npz, parquet
from exodrake.data.log import MAX_COLUMNS, MAX_SAMPLES, check_size, refuse_doubled

JSON, HDF5 = (".json", ".jsonl", ".ndjson"), (".h5", ".hdf5", ".hdf")


def tree_reader(name: str) -> Callable[[bytes, str], Any] | None:
    """The reader of nested values of a file name's ending; None for text."""
    readers = {
        (".mat",): mat.read_variables, (".npy", ".npz"): npz.read_arrays, (".parquet",): parquet.read_columns,
        (".mcap",): mcap.read_columns, JSON: read_records, HDF5: mat.read_hdf5,
    }  # fmt: skip
    return next((reader for endings, reader in readers.items() if name.endswith(endings)), None)


def unpacked(data: bytes, source: str) -> tuple[bytes, str]:
    """Bytes and lower-case name without `.gz`."""
    name = Path(source).name.lower()
    return (csv_gz.unpack(data, source), name.removesuffix(".gz")) if name.endswith(".gz") else (data, name)


def read_columns(data: bytes, source: str, mapped: Mapped) -> dict[str, np.ndarray]:
    """All columns of a foreign table, name -> (n,) as recorded. Of a text file only the mapped ones.

    InputError names file, and column and row where there is text in a mapped column.
    """
    data, name = unpacked(data, source)
    reader = tree_reader(name)
    if reader is None:
        return read_text(data, source, mapped)
    tree = reader(data, source)
    columns = columns_of(tree, source, side=mapped.samples)
    refuse_doubled(columns, source)
    if mapped.time is None or mapped.samples is not None:
        return columns
    time = columns.get(slashed(mapped.time, columns))
    return columns if time is None else columns_of(tree, source, len(time))


def list_columns(data: bytes, source: str) -> dict[str, np.ndarray]:
    """All columns of numbers of a foreign table, for a look at what it holds. InputError if there are none."""
    data, name = unpacked(data, source)
    reader = tree_reader(name)
    found = read_all(data, source) if reader is None else columns_of(reader(data, source), source)
    if not found:
        raise InputError(f"{source}: no column of numbers")
    return found


def slashed(name: str, columns: dict[str, np.ndarray]) -> str:
    """A name as the columns have it: HDF5's `group/data` is `group.data`."""
    return name if name in columns else name.strip("/").replace("/", ".")


def read_records(data: bytes, source: str) -> Any:
    """The content of a JSON file. InputError for a damaged or too large one."""
    check_size(data.count(b","), source)
    return in_child(parse_records, data, source, source=source, size=len(data))


def parse_records(data: bytes, source: str) -> Any:
    """`read_records` in this process."""
    if not source.lower().endswith(".json"):
        lines = enumerate(data.removeprefix(b"\xef\xbb\xbf").splitlines(), 1)
        return [parse_json(line, f"{source}, record {number}") for number, line in lines if line.strip()]
    found = parse_json(data, source)
    if not isinstance(found, dict | list):
        raise InputError(f"{source}: holds one value, wanted objects or lists")
    return found


NUMBERS = "fiub"  # kinds of arrays
MAX_DEPTH = 20
SIDES = ("rows", "columns")


def columns_of(tree: Any, source: str, samples: int | None = None, side: str | None = None) -> dict[str, np.ndarray]:
    """Columns by name, (n,) each. InputError for a name that comes twice.

    Args:
        tree: mappings, lists and arrays.
        source: file, for messages.
        samples: length of the time column; None if it is not known.
        side: where the samples of a matrix lie, one of `SIDES`; None: by their number.
    """
    found: dict[str, np.ndarray] = {}
    try:
        add(found, tree, "", samples, side, 0)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
    return found


def add(found: dict[str, np.ndarray], value: Any, name: str, samples: int | None, side: str | None, depth: int) -> None:
    """Adds the columns of a value to those found."""
    if depth > MAX_DEPTH or len(found) > MAX_COLUMNS:
        return
    if isinstance(value, Mapping):
        for key, item in value.items():
            add(found, item, f"{name}.{key}" if name else str(key), samples, side, depth + 1)
        return
    if isinstance(value, list | tuple) and (value and isinstance(value[0], Mapping)):
        if len(value) > 1 and all(isinstance(one, Mapping) and one.keys() == value[0].keys() for one in value):
            records = {key: [one[key] for one in value] for key in value[0]}
            if all(simple_record(item[0]) for item in records.values()):
                add(found, records, name, samples, "rows", depth + 1)
                return
        for k, one in enumerate(value):
            add(found, one, f"{name}[{k}]" if name else str(k), samples, side, depth + 1)
        return
    array = numbers(value)
    if array is None and isinstance(value, list | tuple):
        for k, one in enumerate(value):
            if not simple(one):
                add(found, one, f"{name}[{k}]" if name else str(k), samples, side, depth + 1)
    elif array is not None:
        wide = array.ndim > 1
        turned = array.T if wide and lie_in_rows(array.shape, samples, side) else array
        for k, values in enumerate(turned if wide else [array]):
            column = f"{name}[{k}]" if wide and name else name or str(k)
            if column in found:  # such as `a.b` of a group `a` beside a data set `a.b`
                raise InputError(f"column {column!r} comes twice")
            found[column] = values.astype(float)


def simple_record(value: Any) -> bool:
    """Whether a value is simple, or a mapping whose values are."""
    return all(map(simple_record, value.values())) if isinstance(value, Mapping) else simple(value)


def simple(value: Any) -> bool:
    """Whether a value is a number, text, or a short list of them: what one record of a table holds."""
    if isinstance(value, list | tuple):
        return all(not isinstance(one, Mapping | list | tuple) for one in value)
    return not isinstance(value, Mapping) and np.ndim(value) == 0


def numbers(value: Any) -> np.ndarray | None:
    """A value as an array of numbers of one or two axes, axes of length 1 left out; None if it is none."""
    if isinstance(value, str | bytes) or value is None:
        return None
    try:
        array = np.asarray(value)
        if array.dtype.kind == "O":  # lists with None for a missing sample
            array = np.array([np.nan if one is None else one for one in array.ravel()], float).reshape(array.shape)
    except (ValueError, TypeError, OverflowError):
        return None
    if array.dtype.kind not in NUMBERS or not array.size:
        return None
    array = array.reshape([n for n in array.shape if n > 1] or [1])
    return array if array.ndim <= 2 else None


def lie_in_rows(shape: Sequence[int], samples: int | None, side: str | None) -> bool:
    """Whether a matrix (rows, columns) has a row for each sample."""
    if side is not None:
        return side == "rows"
    rows, columns = shape
    return rows == samples if samples in (rows, columns) else rows >= columns


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
