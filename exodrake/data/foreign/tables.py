"""Columns of foreign tables by name: text, MAT, HDF5, JSON, NPY, NPZ, Parquet, and MCAP that is a log of ours.

A cell `[1, 2, 3]`, and a matrix, make columns `name[0]`, `name[1]` ...; a field of a struct or group is `outer.inner`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.foreign.mapping import Mapped
from exodrake.data.foreign.text import read_all, read_text
from exodrake.data.foreign.tree import columns_of
from exodrake.data.log import refuse_doubled

JSON, HDF5 = (".json", ".jsonl", ".ndjson"), (".h5", ".hdf5", ".hdf")


def tree_reader(name: str) -> Callable[[bytes, str], Any] | None:
    """The reader of nested values of a file name's ending; None for text."""
    if name.endswith(".mat"):
        from exodrake.data.formats.mat import read_variables

        return read_variables
    if name.endswith((".npy", ".npz")):
        from exodrake.data.formats.npz import read_arrays

        return read_arrays
    if name.endswith(".parquet"):
        from exodrake.data.formats.parquet import read_columns as read_parquet

        return read_parquet
    if name.endswith(".mcap"):
        from exodrake.data.formats.mcap import read_columns as read_mcap

        return read_mcap
    if name.endswith(JSON):
        from exodrake.data.foreign.json_file import read_records

        return read_records
    if name.endswith(HDF5):
        from exodrake.data.hdf5 import read_hdf5

        return read_hdf5
    return None


def unpacked(data: bytes, source: str) -> tuple[bytes, str]:
    """Bytes and lower-case name without `.gz`."""
    name = Path(source).name.lower()
    if not name.endswith(".gz"):
        return data, name
    from exodrake.data.formats.csv_gz import unpack

    return unpack(data, source), name.removesuffix(".gz")


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
