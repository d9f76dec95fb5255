"""A mapping file: what a foreign recording's columns are called, and in which units, by us.

    time: {column: timestamp, unit: us, start: 0}     # start [s]: shift the clock so that the first row has this time
    columns:                                          # foreign column: ours; SI value = (value * scale + offset) in
    unit
      load_cell_1: {name: tension_AF, unit: mN, scale: 0.5, offset: -12}
      "positions[0]": {name: position_shoulder, unit: deg}             # first number of a cell that holds a list
      "/joint_states:position[MCP]": {name: angle_MCP, unit: rad}      # ROS 2: topic, field, element by joint name
    period: 0.02          # s: put the rows on frames of this length; left out, they stay as recorded
    hold: 1               # frames a sample stays valid for when none newer has come
    separator: ";"        # of a text file, default ","; " " stands for any white space
    decimal: ","          # default "."
    skip: 3               # lines before the heading, default 0
    heading: false        # no heading: columns are called 0, 1, 2 ...
    stamp: header         # ROS 2: the message's own stamp, not the recorder's

With `time: {period: 0.02}` instead of a column, row n starts at n times the period.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.files import read_yaml
from exodrake.core.units import check_unit
from exodrake.data.case_file import check_keys

KEYS = ("time", "columns", "period", "hold", "separator", "decimal", "skip", "heading", "stamp")
TIME_KEYS = ("column", "unit", "start", "period")
COLUMN_KEYS = ("name", "unit", "scale", "offset")


@dataclass(frozen=True)
class Column:
    """One foreign column and ours. The SI value is (value * scale + offset) converted from unit."""

    foreign: str
    name: str
    unit: str
    scale: float
    offset: float


@dataclass(frozen=True)
class Mapped:
    """A mapping file's content. time: foreign column or None, then time_period [s] counts rows. start [s] or None."""

    columns: tuple[Column, ...]
    time: str | None
    time_unit: str
    time_period: float | None
    start: float | None
    period: float | None
    hold: int
    separator: str
    decimal: str
    skip: int
    heading: bool
    stamp: str


def read_mapping(path: str | Path) -> Mapped:
    """Read and check a mapping file. InputError names file and key."""
    page = check_keys(read_yaml(path), KEYS, str(path))
    time = check_keys(page.get("time") or {}, TIME_KEYS, f"{path}: key 'time'")
    where = f"{path}: key"
    return Mapped(
        columns=_columns(page.get("columns"), path),
        time=None if time.get("column") is None else str(time["column"]),
        time_unit=_time_unit(time, path),
        time_period=_number(time, "period", None, f"{path}: key 'time',", above=0),
        start=_number(time, "start", None, f"{path}: key 'time',"),
        period=_number(page, "period", None, where, above=0),
        hold=int(_number(page, "hold", 1, where, above=-1) or 0),
        separator=_text(page, "separator", ",", where),
        decimal=_text(page, "decimal", ".", where),
        skip=int(_number(page, "skip", 0, where, above=-1) or 0),
        heading=_choice(page, "heading", (True, False), where),
        stamp=_choice(page, "stamp", ("log", "header"), where),
    )


def _columns(given: Any, path: str | Path) -> tuple[Column, ...]:
    if not isinstance(given, Mapping) or not given:
        raise InputError(f"{path}: key 'columns': wanted foreign columns and what they are, found {given!r}")
    columns = []
    for foreign, item in given.items():
        where = f"{path}: key 'columns', {str(foreign)!r}"
        entry = check_keys(item, COLUMN_KEYS, where)
        for key in ("name", "unit"):
            if not isinstance(entry.get(key), str) or not entry[key].strip():
                raise InputError(f"{where}: key {key!r} is missing")
        check_unit(entry["name"], entry["unit"], where)
        scale, offset = (
            _number(entry, key, value, f"{where}: key") for key, value in (("scale", 1.0), ("offset", 0.0))
        )
        columns.append(Column(str(foreign), entry["name"].strip(), entry["unit"], scale or 0.0, offset or 0.0))
    names = [column.name for column in columns]
    for name in names:
        if names.count(name) > 1 or name == "time":
            raise InputError(f"{path}: key 'columns': {name!r} is the name of more than one column")
    return tuple(columns)


def _time_unit(time: Mapping, path: str | Path) -> str:
    unit = str(time.get("unit", "s"))
    check_unit("time", unit, f"{path}: key 'time'")
    return unit


def _number(page: Mapping, key: str, default: float | None, where: str, above: float | None = None) -> float | None:
    value = page.get(key, default)
    if value is None:
        return None
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{where} {key!r}: wanted a number, found {value!r}") from None
    if abs(number) == float("inf") or number != number or (above is not None and number <= above):
        raise InputError(f"{where} {key!r}: {value!r} is out of range")
    return number


def _text(page: Mapping, key: str, default: str, where: str) -> str:
    value = page.get(key, default)
    if not isinstance(value, str) or len(value) != 1:
        raise InputError(f"{where} {key!r}: wanted one character, found {value!r}")
    return value


def _choice(page: Mapping, key: str, allowed: tuple, where: str) -> Any:
    """The first of `allowed` is the default."""
    value = page.get(key, allowed[0])
    if value not in allowed:
        raise InputError(f"{where} {key!r}: {value!r} is none of {', '.join(map(repr, allowed))}")
    return value
