"""A mapping file: what a foreign recording's columns are called, and in which units, by us.

    time: {column: timestamp, unit: us, start: 0}     # start [s]: shift the clock so that the first row has this time
    columns:                                          # foreign column: ours; SI value = (value * scale + offset) in
    unit
      load_cell_1: {name: tension_AF, unit: mN, scale: 0.5, offset: -12}
      "positions[0]": {name: position_shoulder, unit: deg}             # first number of a cell that holds a list
      "/joint_states:position[MCP]": {name: angle_MCP, unit: rad}      # ROS 2: topic, field, element by joint name
    derived:              # of our columns; names and units are ours, in SI
      angle_start_MCP: {of: angle_MCP, take: first}                     # its first sample, held
      angle_speed_MCP: {of: angle_MCP, take: rate, filter: 8}           # derivative
      twist: {of: angle_motor, minus: angle_MCP, scale: 0.5}            # difference of two
    sync:                 # clocks that differ: move `columns` in time until `by` fits `with` best
      - {columns: [angle_MCP], by: angle_MCP, with: angle_ref_MCP, within: 0.5}
    period: 0.02          # s: put the rows on frames of this length; left out, they stay as recorded
    hold: 1               # frames a sample stays valid for when none newer has come
    separator: ";"        # of text, default ","; a blank stands for any white space
    decimal: ","          # default "."
    skip: 3               # lines before the heading, default 0
    heading: false        # no heading: columns are called 0, 1, 2 ...
    samples: columns      # of a matrix: a column for each sample; by default where there are as many as times
    stamp: header         # ROS 2: the message's own stamp, not the recorder's

A column may further have `sign: -1`, `wrap: 360` (a reading that starts again after so much, in the foreign unit, is
made continuous) and `filter: 10` (zero-phase low-pass, cut-off in Hz). What it changes is noted beside the log.

With `time: {period: 0.02}` instead of a column, row n starts at n times the period.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.errors import InputError, nearest
from exodrake.core.schema import flag, inside, listing, mapping, names, number, optional, refusal, text, whole
from exodrake.core.units import check_unit
from exodrake.core.yaml_file import read_yaml

TAKEN = ("first", "rate")
SIDES = ("rows", "columns")
LARGEST = 1e300  # of a finite number
FINITE = number(low=-LARGEST, high=LARGEST)
SHORTEST = 1e-9  # s, a tick of the finest recorder
PERIOD = number(low=SHORTEST, high=LARGEST, unit="s")


def column_name(value: Any, where: str) -> str:
    """A foreign column's name, or its number in a table without heading."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else text()(value, where)


POSITIVE = number(above=0.0, high=LARGEST)
COLUMN = mapping(
    {
        "name": text(), "unit": text(), "scale": FINITE, "offset": FINITE, "sign": FINITE, "wrap": POSITIVE,
        "filter": POSITIVE,
    },
    required=("name", "unit"),
)  # fmt: skip
DERIVED = mapping(
    {
        "of": text(), "take": text(TAKEN), "minus": text(), "scale": FINITE, "offset": FINITE, "filter": POSITIVE,
        "unit": text(),
    },
    required=("of",),
)  # fmt: skip
SYNC = mapping(
    {"columns": listing(text(), least=1), "by": text(), "with": text(), "within": PERIOD},
    required=("columns", "by", "with", "within"),
)
TIME = mapping({"column": optional(column_name), "unit": text(), "start": optional(FINITE), "period": optional(PERIOD)})
SCHEMA = mapping(
    {
        "time": optional(TIME),
        "columns": names(COLUMN, least=1),
        "derived": optional(names(DERIVED)),
        "sync": optional(listing(SYNC)),
        "period": optional(PERIOD),
        "hold": whole(),
        "separator": text(length=1),
        "decimal": text(length=1),
        "skip": whole(),
        "heading": flag,
        "samples": text(SIDES),
        "stamp": text(("log", "header")),
    },
    required=("columns",),
)


@dataclass(frozen=True)
class Column:
    """A foreign column and the log column that it becomes: sign (value * scale + offset), converted from its unit.

    Attributes:
        foreign: name of the foreign column.
        name: name of the log column.
        unit: foreign unit.
        scale: factor on the value.
        offset: added after the factor [foreign unit].
        sign: 1 or -1.
        wrap: value at which readings start again [foreign unit]; None if they do not.
        filter: cut-off of a zero-phase low-pass [Hz]; None for none.
    """

    foreign: str
    name: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0
    sign: float = 1.0
    wrap: float | None = None
    filter: float | None = None


@dataclass(frozen=True)
class Derived:
    """A column made from one of ours: (take(of) - minus) scale + offset [SI], low-passed at `filter` [Hz]."""

    name: str
    of: str
    take: str = ""
    minus: str = ""
    scale: float = 1.0
    offset: float = 0.0
    filter: float | None = None
    unit: str = ""


@dataclass(frozen=True)
class Sync:
    """Columns that are moved in time, at most `within` [s], until column `by` of them correlates best with `to`."""

    columns: tuple[str, ...]
    by: str
    to: str
    within: float


@dataclass(frozen=True)
class Mapped:
    """Content of a mapping file.

    Attributes:
        columns: foreign columns and the log columns that they become.
        time: foreign column of the time; None where `time_period` counts rows.
        time_unit: foreign unit of the time.
        time_period: time between two rows [s]; None where there is a column of the time.
        start: time at which the log starts [s]; None: as recorded.
        period: frame period of the log [s]; None leaves rows as recorded.
        hold: frames for which a sample stays valid.
        separator: separator of text.
        decimal: decimal point of text.
        skip: lines before the heading.
        heading: whether there is a heading.
        stamp: time of ROS 2 messages: "log" (recorder) or "header" (message).
        samples: "rows" or "columns" of a matrix; None: by its shape.
        derived: columns made from others.
        sync: columns that are moved in time.
    """

    columns: tuple[Column, ...]
    time: str | None = None
    time_unit: str = "s"
    time_period: float | None = None
    start: float | None = None
    period: float | None = None
    hold: int = 1
    separator: str = ","
    decimal: str = "."
    skip: int = 0
    heading: bool = True
    stamp: str = "log"
    samples: str | None = None
    derived: tuple[Derived, ...] = ()
    sync: tuple[Sync, ...] = ()


@dataclass(frozen=True, eq=False)
class Track:
    """A foreign column with a clock of its own: time (n,) s, values (n,) in the foreign unit."""

    time: np.ndarray
    values: np.ndarray


PLAIN = ("hold", "separator", "decimal", "skip", "heading", "stamp", "samples")


def read_mapping(path: str | Path) -> Mapped:
    """Reads and checks a mapping file; InputError names file and key."""
    content = SCHEMA(read_yaml(path), str(path))
    time = content.get("time") or {}
    check_unit("time", time.get("unit", "s"), f"{path}, 'time'")
    columns = _columns(content["columns"], f"{path}, 'columns'")
    derived = _derived(content.get("derived") or {}, columns, f"{path}, 'derived'")
    known = [column.name for column in columns]
    return Mapped(
        columns=columns,
        time=time.get("column"),
        time_unit=time.get("unit", "s"),
        time_period=time.get("period"),
        start=time.get("start"),
        period=content.get("period"),
        derived=derived,
        sync=tuple(_sync(item, known, f"{path}, 'sync'") for item in content.get("sync") or ()),
        **{key: content[key] for key in PLAIN if key in content},
    )


def _columns(content: dict[str, dict[str, Any]], where: str) -> tuple[Column, ...]:
    """The columns; refuses a unit that does not suit its column, and a name that comes twice."""
    columns = []
    for foreign, item in content.items():
        name = item["name"].strip()
        if not name or not item["unit"].strip():
            raise refusal(inside(where, foreign), f"key {'unit' if name else 'name'!r} is missing")
        check_unit(name, item["unit"], inside(where, foreign))
        if abs(item.get("sign", 1.0)) != 1.0:
            raise refusal(inside(inside(where, foreign), "sign"), f"wanted 1 or -1, found {item['sign']:g}")
        columns.append(Column(foreign, **{**item, "name": name}))
    taken = [column.name for column in columns]
    for name in taken:
        if taken.count(name) > 1 or name == "time":
            raise InputError(f"{where}: {name!r} is the name of more than one column")
    return tuple(columns)


def _derived(content: dict[str, dict[str, Any]], columns: tuple[Column, ...], where: str) -> tuple[Derived, ...]:
    """The derived columns, in order; refuses one of a column that comes later or is not there, and a doubled name."""
    known, found = [column.name for column in columns], []
    for name, item in content.items():
        for key in ("of", "minus"):
            if item.get(key, known[0]) not in known:
                raise refusal(inside(where, name), f"{item[key]!r} is no column above it{nearest(item[key], known)}")
        if name in known or name == "time":
            raise refusal(inside(where, name), "is the name of another column")
        if item.get("unit"):
            check_unit(name, item["unit"], inside(where, name))
        known.append(name)
        found.append(Derived(name, **item))
    return tuple(found)


def _sync(item: dict[str, Any], known: list[str], where: str) -> Sync:
    """One entry of `sync`; refuses columns that are not there, and one that is moved to fit itself."""
    for name in (*item["columns"], item["by"], item["with"]):
        if name not in known:
            raise refusal(where, f"{name!r} is no column{nearest(name, known)}")
    if item["by"] not in item["columns"] or item["with"] in item["columns"]:
        raise refusal(where, "`by` is one of the columns that are moved, and `with` is none of them")
    return Sync(tuple(item["columns"]), item["by"], item["with"], item["within"])
