"""Logs as pandas DataFrames, and back. pandas is optional: `pip install exodrake[pandas]`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.units import check_unit, default_unit, to_si

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
    found, known = {}, {}
    columns = [(str(name), values) for name, values in frame.items()]
    if not any(split(name)[0] == TIME for name, _ in columns):
        columns.insert(0, (TIME, frame.index))
    for text, values in columns:
        name, unit = split(text)
        if name in found:
            raise InputError(f"{source}: column {name!r} comes twice")
        where = f"{source}, column {name!r}"
        unit = unit or units.get(name) or default_unit(name)
        known[name] = check_unit(name, unit, where)
        found[name] = to_si(numbers(values, name, source), unit, where)
    return found, known


def split(heading: str) -> tuple[str, str]:
    """Name and unit of a heading such as `tension_AF [N]`; unit "" without brackets."""
    name, _, unit = heading.partition("[")
    return name.strip(), unit.rstrip("] ")


def numbers(values: Any, name: str, source: str) -> np.ndarray:
    """A column (n,) [any unit] as float64, time differences in seconds; InputError naming one that is not numeric."""
    array = np.asarray(values)
    if array.dtype.kind == "m":
        return array / np.timedelta64(1, "s")
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{source}: column {name!r} is not numeric") from None
