"""Parquet: one double column per signal under its heading, null where a sample is missing. Extra: `parquet`."""

import io
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.columns import headings, log_from_columns
from exodrake.data.log import Log

ENDINGS = (".parquet",)


def read(data: bytes, source: str) -> Log:
    """Parse a Parquet log. InputError for a damaged file, a column that is not numeric, and pyarrow not installed."""
    table = _table(data, source)
    return log_from_columns([(name, _numbers(table.column(i), name, source)) for i, name in _named(table)], source)


def read_columns(data: bytes, source: str) -> dict[str, np.ndarray]:
    """Numeric columns of any Parquet file by name, (n,) as recorded."""
    table = _table(data, source)
    return {name: _numbers(table.column(i), name, source) for i, name in _named(table) if _numeric(table.column(i))}


def write(log: Log) -> bytes:
    """The log as Parquet in SI."""
    arrow, parquet = _pyarrow(log.label)
    columns = [arrow.array(values, from_pandas=True) for values in (log.time, *log.signals.values())]  # NaN to null
    stream = io.BytesIO()
    parquet.write_table(arrow.table(columns, names=headings(log)), stream)
    return stream.getvalue()


def _table(data: bytes, source: str) -> Any:
    _, parquet = _pyarrow(source)
    try:
        return parquet.read_table(io.BytesIO(data))
    except Exception as error:  # the parser raises whatever damaged bytes lead it to
        raise InputError(f"{source}: not a whole Parquet file ({type(error).__name__})") from None


def _named(table: Any) -> list[tuple[int, str]]:
    """Columns by number, since a file may hold the same name twice."""
    return list(enumerate(table.column_names))


def _numeric(column: Any) -> bool:
    import pyarrow

    kind = column.type
    return pyarrow.types.is_floating(kind) or pyarrow.types.is_integer(kind) or pyarrow.types.is_null(kind)


def _numbers(column: Any, name: str, source: str) -> np.ndarray:
    import pyarrow

    if not _numeric(column):
        raise InputError(f"{source}: column {name!r} is {column.type}, wanted numbers")
    return column.cast(pyarrow.float64(), safe=False).fill_null(float("nan")).to_numpy()


def _pyarrow(source: str) -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            f"{source}: Parquet needs pyarrow; install exodrake[parquet], or use .csv.gz or .npz"
        ) from None
    return pyarrow, pyarrow.parquet
