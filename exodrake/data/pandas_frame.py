"""Logs as pandas DataFrames, and back. pandas is optional: `pip install exodrake[pandas]`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.headings import columns_in_si

if TYPE_CHECKING:
    from exodrake.data.log import Log

TIME = "time"


def frame_of(log: Log) -> Any:
    """A DataFrame indexed by time [s]; `attrs` hold units and source. InputError where pandas is not installed."""
    try:
        import pandas  # pyright: ignore
    except ImportError:
        raise InputError("pandas is not installed; pip install exodrake[pandas]") from None
    frame = pandas.DataFrame(dict(log.signals), index=pandas.Index(log.time, name=TIME))
    frame.attrs = {"units": dict(log.units), "source": log.source}
    return frame


def columns_of(frame: Any, units: Mapping[str, str], source: str) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Columns (n,) [SI] of a DataFrame by name, time among them, and their units.

    Args:
        frame: columns named `tension_AF` or `tension_AF [N]`; time in a column `time`, or as index.
        units: of columns without one; else SI by the kind.
        source: name for messages.

    Raises:
        InputError: naming a column that comes twice, is not numeric, or whose unit is unknown or unsuitable.
    """
    columns = [(str(name), numbers(values, str(name), source)) for name, values in frame.items()]
    if not any(name.partition("[")[0].strip() == TIME for name, _ in columns):
        columns.insert(0, (TIME, numbers(frame.index, TIME, source)))
    return columns_in_si(columns, source, units)


def numbers(values: Any, name: str, source: str) -> np.ndarray:
    """A column (n,) [any unit] as float64, time differences in s; InputError naming one that is not numeric."""
    array = np.asarray(values)
    if array.dtype.kind == "m":
        return array / np.timedelta64(1, "s")
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{source}: column {name!r} is not numeric") from None
