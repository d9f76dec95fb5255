"""Parquet: one double column per signal under its heading, null where a sample is missing. Extra: `parquet`."""

import io
from typing import Any

import numpy as np

from exodrake.errors import InputError
from exodrake.formats.table import headings, log_from_columns
from exodrake.log import Log


def read(data: bytes, source: str) -> Log:
    """Parse a Parquet log. InputError for a damaged file, a column that is not numeric, and pyarrow not installed."""
    arrow, parquet = _pyarrow(source)
    try:
        table = parquet.read_table(io.BytesIO(data))
    except (arrow.ArrowException, OSError, ValueError) as error:
        raise InputError(f"{source}: not a whole Parquet file ({str(error).splitlines()[0]})") from None
    return log_from_columns(
        (
            (name, _numbers(column, name, source, arrow))
            for name, column in zip(table.column_names, table.columns, strict=True)
        ),
        source,
    )


def write(log: Log) -> bytes:
    """The log as Parquet in SI."""
    arrow, parquet = _pyarrow(log.label)
    columns = [arrow.array(values, from_pandas=True) for values in (log.time, *log.signals.values())]  # NaN to null
    stream = io.BytesIO()
    parquet.write_table(arrow.table(columns, names=headings(log)), stream)
    return stream.getvalue()


def _numbers(column: Any, name: str, source: str, arrow: Any) -> np.ndarray:
    kind = column.type
    if not (arrow.types.is_floating(kind) or arrow.types.is_integer(kind) or arrow.types.is_null(kind)):
        raise InputError(f"{source}: column {name!r} is {kind}, wanted numbers")
    return column.cast(arrow.float64(), safe=False).fill_null(float("nan")).to_numpy()


def _pyarrow(source: str) -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            f"{source}: Parquet needs pyarrow; install exodrake[parquet], or use .csv.gz or .npz"
        ) from None
    return pyarrow, pyarrow.parquet
