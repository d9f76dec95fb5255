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

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.schema import flag, inside, mapping, names, number, optional, refusal, text, whole
from exodrake.core.units import check_unit
from exodrake.core.yaml_file import read_yaml

LARGEST = 1e300  # of a finite number
FINITE = number(low=-LARGEST, high=LARGEST)
PERIOD = number(above=0.0, high=LARGEST, unit="s")


def column_name(value: Any, where: str) -> str:
    """A foreign column's name, or its number in a table without heading."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else text()(value, where)


COLUMN = mapping({"name": text(), "unit": text(), "scale": FINITE, "offset": FINITE}, required=("name", "unit"))
TIME = mapping({"column": optional(column_name), "unit": text(), "start": optional(FINITE), "period": optional(PERIOD)})
SCHEMA = mapping(
    {
        "time": optional(TIME),
        "columns": names(COLUMN, least=1),
        "period": optional(PERIOD),
        "hold": whole(),
        "separator": text(length=1),
        "decimal": text(length=1),
        "skip": whole(),
        "heading": flag,
        "stamp": text(("log", "header")),
    },
    required=("columns",),
)


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
    """Reads and checks a mapping file; InputError names file and key."""
    content = SCHEMA(read_yaml(path), str(path))
    time = content.get("time") or {}
    check_unit("time", time.get("unit", "s"), f"{path}, 'time'")
    return Mapped(
        columns=_columns(content["columns"], f"{path}, 'columns'"),
        time=time.get("column"),
        time_unit=time.get("unit", "s"),
        time_period=time.get("period"),
        start=time.get("start"),
        period=content.get("period"),
        hold=content.get("hold", 1),
        separator=content.get("separator", ","),
        decimal=content.get("decimal", "."),
        skip=content.get("skip", 0),
        heading=content.get("heading", True),
        stamp=content.get("stamp", "log"),
    )


def _columns(content: dict[str, dict[str, Any]], where: str) -> tuple[Column, ...]:
    """The columns; refuses a unit that does not suit its column, and a name that comes twice."""
    columns = []
    for foreign, item in content.items():
        name = item["name"].strip()
        if not name or not item["unit"].strip():
            raise refusal(inside(where, foreign), f"key {'unit' if name else 'name'!r} is missing")
        check_unit(name, item["unit"], inside(where, foreign))
        columns.append(Column(foreign, name, item["unit"], item.get("scale", 1.0), item.get("offset", 0.0)))
    taken = [column.name for column in columns]
    for name in taken:
        if taken.count(name) > 1 or name == "time":
            raise InputError(f"{where}: {name!r} is the name of more than one column")
    return tuple(columns)
