"""Columns of foreign tables by name: text, MAT, HDF5, JSON, NPY, NPZ, Parquet, MCAP of ours, and LeRobot data sets.

A matrix makes columns `name[0]` ..., or `action[shoulder_pan]` where names are stated; a field of a struct or group is
`outer.inner`. A LeRobot data set (v2 or v3) is a folder with `meta/info.json` and Parquet files; video is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import is_file, read_bytes
from exodrake.core.schema import parse_json, read_json
from exodrake.data.formats import mat, mcap, npz, parquet, read_apart
from exodrake.data.formats.csv import guess_layout, read_text, unpack
from exodrake.data.log import MAX_COLUMNS, check_size, refuse_doubled

if TYPE_CHECKING:
    from exodrake.data.import_log import Mapped

JSON, HDF5 = (".json", ".jsonl", ".ndjson"), (".h5", ".hdf5", ".hdf")
MAX_DEPTH = 20  # of nested values
INFO = "meta/info.json"
EPISODE, TIME = "episode_index", "timestamp"
FASTEST = 1e6  # Hz


def read_columns(data: bytes, source: str, mapped: Mapped) -> dict[str, np.ndarray]:
    """Mapped columns (n,) of a foreign table by name, as recorded, and others of a table of numbers."""
    data, tree = open_table(data, source)
    if tree is None:
        return read_text(data, source, mapped, mapped.foreign)
    columns = flatten(tree, source, side=mapped.samples)
    refuse_doubled(columns, source)
    if mapped.time is None or mapped.samples is not None:
        return columns
    time = columns.get(resolve(mapped.time, columns))
    return columns if time is None else flatten(tree, source, len(time))


def list_columns(data: bytes, source: str) -> dict[str, np.ndarray]:
    """All columns of numbers of a foreign table, for a look at what it holds. InputError if there are none."""
    data, tree = open_table(data, source)
    found = read_text(data, source, guess_layout(data), strict=False) if tree is None else flatten(tree, source)
    if not found:
        raise InputError(f"{source}: no column of numbers")
    return found


def open_table(data: bytes, source: str) -> tuple[bytes, Any]:
    """Bytes without gzip, and the nested values of a binary or JSON file; None for text."""
    name = Path(source).name.lower()
    if name.endswith(".gz"):
        data, name = unpack(data, source), name.removesuffix(".gz")
    if name.endswith((".npy", ".npz")):
        return data, npz.read_arrays(data, source)
    parsers = {".mat": mat.parse, ".parquet": parquet.parse, ".mcap": mcap.parse}
    parsers |= dict.fromkeys(JSON, parse_records) | dict.fromkeys(HDF5, mat.parse_hdf5)
    parser = parsers.get(Path(name).suffix)
    return data, None if parser is None else read_apart(parser, data, source)


def resolve(name: str, columns: Mapping[str, Any]) -> str:
    """A name as the columns have it: HDF5's `group/data` is `group.data`."""
    return name if name in columns else name.strip("/").replace("/", ".")


def parse_records(data: bytes, source: str) -> Any:
    """The content of a JSON file, in this process. InputError for a damaged or too large one."""
    check_size(data.count(b","), source)
    if not source.lower().removesuffix(".gz").endswith(".json"):
        lines = enumerate(data.removeprefix(b"\xef\xbb\xbf").splitlines(), 1)
        return [parse_json(line, f"{source}, record {number}") for number, line in lines if line.strip()]
    found = parse_json(data, source)
    if not isinstance(found, dict | list):
        raise InputError(f"{source}: holds one value, wanted objects or lists")
    return found


def flatten(tree: Any, source: str, samples: int | None = None, side: str | None = None) -> dict[str, np.ndarray]:
    """Columns (n,) of nested values by name; a matrix lies along `side`, else as it has as many rows as `samples`."""
    found: dict[str, np.ndarray] = {}

    def add(value: Any, name: str, side: str | None, depth: int) -> None:
        if depth > MAX_DEPTH or len(found) > MAX_COLUMNS:
            return
        if isinstance(value, Mapping):
            for key, item in value.items():
                add(item, f"{name}.{key}" if name else str(key), side, depth + 1)
            return
        records = isinstance(value, list | tuple) and bool(value) and isinstance(value[0], Mapping)
        alike = records and all(isinstance(one, Mapping) and one.keys() == value[0].keys() for one in value)
        if alike and len(value) > 1:
            table = {key: [one[key] for one in value] for key in value[0]}
            if all(_is_simple(item[0], nested=True) for item in table.values()):
                add(table, name, "rows", depth + 1)
                return
        array = None if records else _array(value)
        if array is None and isinstance(value, list | tuple):
            for k, one in enumerate(value):
                if records or not _is_simple(one):
                    add(one, f"{name}[{k}]" if name else str(k), side, depth + 1)
        elif array is not None:
            many = array.ndim > 1
            rows = array.shape[0] == samples if samples in array.shape else array.shape[0] >= array.shape[-1]
            if many and (side == "rows" if side else rows):
                array = array.T
            for k, values in enumerate(np.atleast_2d(array)):
                column = f"{name}[{k}]" if many and name else name or str(k)
                if column in found:  # such as `a.b` of a group `a` beside a data set `a.b`
                    raise InputError(f"{source}: column {column!r} comes twice")
                found[column] = values.astype(float)

    add(tree, "", side, 0)
    return found


def _is_simple(value: Any, nested: bool = False) -> bool:
    """Whether a value is a number, text or a list of them; `nested`: or a mapping of such."""
    if isinstance(value, Mapping):
        return nested and all(_is_simple(one, True) for one in value.values())
    several = isinstance(value, list | tuple)
    return not any(isinstance(one, Mapping | list | tuple) for one in value) if several else np.ndim(value) == 0


def _array(value: Any) -> np.ndarray | None:
    """A value as an array of numbers of one or two axes, axes of length 1 left out; None if it is none."""
    if isinstance(value, str | bytes) or value is None:
        return None
    try:
        array = np.asarray(value)
        if array.dtype.kind == "O":  # lists with None for a missing sample
            array = np.array([np.nan if one is None else one for one in array.ravel()], float).reshape(array.shape)
    except (ValueError, TypeError, OverflowError):
        return None
    if array.dtype.kind not in "fiub" or not array.size:
        return None
    array = array.reshape([n for n in array.shape if n > 1] or [1])
    return array if array.ndim <= 2 else None


def is_dataset(path: str | Path) -> bool:
    """Whether a path is the folder of a LeRobot data set."""
    return is_file(Path(path) / INFO)


def read_info(path: Path) -> dict[str, Any]:
    """`meta/info.json`. InputError for one without rate or features."""
    found = read_json(path / INFO)
    rate, features = (found.get(key) if isinstance(found, dict) else None for key in ("fps", "features"))
    if not isinstance(rate, int | float) or not 0 < rate < FASTEST or not isinstance(features, dict):
        raise InputError(f"{path / INFO}: wanted 'fps' above 0 and 'features', as LeRobot writes them")
    return found


def element_names(info: dict[str, Any], column: str) -> list[str]:
    """Names of the elements of a column, as the data set states them; none if it does not."""
    feature = info["features"].get(column)
    names = feature.get("names") if isinstance(feature, dict) else None
    lists = names.values() if isinstance(names, dict) else [names]
    found = [str(name) for name in next((item for item in lists if isinstance(item, list)), [])]
    refuse_doubled(found, f"the names of {column!r} in {INFO}")
    return found


def episodes(path: Path) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    """Name and columns of each episode of a LeRobot data set, in order."""
    info, files = read_info(path), sorted((path / "data").rglob("*.parquet"))
    if not files:
        raise InputError(f"{path}: no Parquet file in its folder 'data'")
    samples, place_of = 0, dict[float, Path]()
    for file in files:
        columns = read_apart(parquet.parse, read_bytes(file), str(file))
        table = {name: values for name, values in columns.items() if not isinstance(values, str)}
        check_size(samples := samples + sum(values.size for values in table.values()), str(path))
        if EPISODE not in table or TIME not in table:
            raise InputError(f"{file}: no column {EPISODE!r} and {TIME!r}, as a LeRobot data set has")
        if table[EPISODE].ndim > 1 or not np.isfinite(table[EPISODE]).all():
            raise InputError(f"{file}: column {EPISODE!r}: wanted one number in each row")
        for number in np.unique(table[EPISODE]):
            if (other := place_of.setdefault(number, file)) is not file:
                there = other.relative_to(path)
                raise InputError(f"{file}: episode {int(number)} is also in {there}, so one of them would be lost")
            columns: dict[str, np.ndarray] = {}
            for name, values in table.items():
                values = values[table[EPISODE] == number]
                names, width = element_names(info, name), values.shape[1] if values.ndim > 1 else 0
                columns |= {f"{name}[{k}]": values[:, k] for k in range(width)} or {name: values}
                columns |= {f"{name}[{one}]": values[:, k] for k, one in enumerate(names) if len(names) == width}
            yield f"episode_{int(number):06d}", columns
