"""Parquet: one double column per signal under its heading, null where a sample is missing. Extra: `parquet`."""

import io
from collections.abc import Collection
from typing import Any

import numpy as np

from exodrake.core.errors import InputError, require_extra
from exodrake.data.formats import read_apart
from exodrake.data.log import Log, check_size, headings, log_from_columns, refuse_doubled

ENDINGS = (".parquet",)


def read(data: bytes, source: str) -> Log:
    """Parse a Parquet log. InputError for a damaged file, a column that is not numeric, and pyarrow not installed."""
    columns = read_apart(parse, data, source)
    for name, values in columns.items():
        if isinstance(values, str) or values.ndim > 1:
            found = values if isinstance(values, str) else "a list"
            raise InputError(f"{source}: column {name!r} is {found}, wanted numbers")
    return log_from_columns(columns.items(), source)


def parse(data: bytes, source: str) -> dict[str, Any]:
    """Values of columns by name, (n,) or of lists (n, m), or their type if not numeric."""
    _, parquet = import_pyarrow(source)
    file = parquet.ParquetFile(io.BytesIO(data))
    check_size(file.metadata.num_rows * file.metadata.num_columns, source)
    table = file.read()
    refuse_doubled(table.column_names, source)
    return {name: _values(table.column(i)) for i, name in enumerate(table.column_names)}


def parse_rows(data: bytes, source: str, wanted: Any, optional: Collection[str] = ()) -> list[dict[str, Any]]:
    """Rows of a table as plain data by the wanted `pyarrow.Schema`; InputError for a column that does not suit."""
    arrow, parquet = import_pyarrow(source)
    try:
        found = parquet.read_table(io.BytesIO(data))
        names = found.column_names  # bytes that are no text raise here
    except Exception as error:  # the parser raises whatever damaged bytes lead it to
        raise InputError(f"{source}: not a whole Parquet file ({type(error).__name__})") from None
    for name in wanted.names:
        if name not in names and name in optional:
            found = found.append_column(name, arrow.nulls(len(found)))
        elif name not in names:
            raise InputError(f"{source}: column {name!r} is missing")
    try:
        return found.select(wanted.names).cast(wanted).to_pylist()
    except Exception as error:  # of types that do not suit, and of bytes that are no text
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{source}: a column has another type or is damaged ({reason})") from None


def write(log: Log) -> bytes:
    """The log as Parquet in SI."""
    arrow, parquet = import_pyarrow(log.label)
    columns = [arrow.array(values, from_pandas=True) for values in (log.time, *log.signals.values())]  # NaN to null
    stream = io.BytesIO()
    parquet.write_table(arrow.table(columns, names=headings(log)), stream)
    return stream.getvalue()


def _values(column: Any) -> np.ndarray | str:
    """A column as numbers (n,), of lists of equal length m (n, m), or its type where it is neither."""
    import pyarrow

    types, kind = pyarrow.types, column.type
    listed = types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)
    inner = kind.value_type if listed else kind
    numeric = types.is_floating(inner) or types.is_integer(inner) or types.is_null(inner)
    if numeric and not listed:
        return column.cast(pyarrow.float64(), safe=False).fill_null(float("nan")).to_numpy()
    rows = column.to_pylist() if numeric else []
    counts = {len(row or ()) for row in rows}
    return np.array(rows, dtype=float) if len(counts) == 1 and counts != {0} else str(kind)


def import_pyarrow(source: str) -> tuple[Any, Any]:
    """The modules `pyarrow` and `pyarrow.parquet`. InputError naming the extra if they are not installed."""
    with require_extra(f"{source}: Parquet needs pyarrow; install exodrake[parquet], or use .csv.gz or .npz"):
        import pyarrow
        import pyarrow.parquet
    return pyarrow, pyarrow.parquet
