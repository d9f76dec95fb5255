"""Columns of foreign tables by name: text, MAT, NPY, NPZ, Parquet.

A cell `[1, 2, 3]`, and a matrix, make columns `name[0]`, `name[1]` ...
"""

import csv
import io
from collections.abc import Iterator, Mapping
from itertools import chain, islice
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.columns import check_size
from exodrake.data.foreign.mapping import Mapped

MISSING = ("", "nan", "na", "null", "none", "-")


def read_columns(data: bytes, source: str, mapped: Mapped) -> dict[str, np.ndarray]:
    """All columns of a foreign table, name -> (n,) as recorded. Of a text file only the mapped ones.

    InputError names file, and column and row where there is text in a mapped column.
    """
    name = Path(source).name.lower()
    if name.endswith(".gz"):
        from exodrake.data.formats.csv_gz import unpack

        return _text(unpack(data, source), source, mapped)
    if name.endswith(".mat"):
        from exodrake.data.formats.mat import read_variables

        return _spread(read_variables(data, source))
    if name.endswith((".npy", ".npz")):
        from exodrake.data.formats.npz import read_arrays

        return _spread(read_arrays(data, source))
    if name.endswith(".parquet"):
        from exodrake.data.formats.parquet import read_columns as read_parquet

        return read_parquet(data, source)
    return _text(data, source, mapped)


def _spread(arrays: Mapping[str, object]) -> dict[str, np.ndarray]:
    """Vectors by name, and the columns of a matrix (n, m) as `name[0]` ... (a nameless one's as `0` ...)."""
    columns = {}
    for name, value in arrays.items():
        array = np.asarray(value)
        if array.dtype.kind not in "fiub" or array.ndim > 2 or not array.size:
            continue
        if array.ndim == 2 and 1 not in array.shape:
            for index in range(array.shape[1]):
                columns[f"{name}[{index}]" if name else str(index)] = array[:, index].astype(float)
        else:
            columns[name or "0"] = array.ravel().astype(float)
    return columns


def _text(data: bytes, source: str, mapped: Mapped) -> dict[str, np.ndarray]:
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
