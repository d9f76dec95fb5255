"""Columns of nested values, as MATLAB structs, HDF5 groups and JSON objects hold them.

    {"run": {"t": (500,), "q": (500, 2)}}            ->  run.t, run.q[0], run.q[1]
    [{"t": 0, "q": [1, 2]}, {"t": 1, "q": [3, 4]}]   ->  t, q[0], q[1]

The samples of a matrix may lie in its rows or its columns: they lie where it is as long as the time column, else along
the longer side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.log import MAX_COLUMNS

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
        matrix(found, array, name, samples, side)


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


def matrix(found: dict[str, np.ndarray], array: np.ndarray, name: str, samples: int | None, side: str | None) -> None:
    """Adds the columns of an array (n,), (n, m) or (m, n)."""
    if array.ndim == 1:
        put(found, name or "0", array)
        return
    for k, values in enumerate(array.T if lie_in_rows(array.shape, samples, side) else array):
        put(found, f"{name}[{k}]" if name else str(k), values)


def put(found: dict[str, np.ndarray], name: str, values: np.ndarray) -> None:
    """Adds a column. InputError for one that is there, such as `a.b` of a group `a` beside a data set `a.b`."""
    if name in found:
        raise InputError(f"column {name!r} comes twice")
    found[name] = values.astype(float)


def lie_in_rows(shape: Sequence[int], samples: int | None, side: str | None) -> bool:
    """Whether a matrix (rows, columns) has a row for each sample."""
    if side is not None:
        return side == "rows"
    rows, columns = shape
    return rows == samples if samples in (rows, columns) else rows >= columns
