"""The heading of a growing log: which cell is which signal, and in which unit."""

from __future__ import annotations

from dataclasses import dataclass
from math import isinf, nan

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.units import check_unit, to_si
from exodrake.data.columns import split_heading
from exodrake.monitor.simulator import KINDS

NEEDED = ("tension_ref", "tension", "stroke")


def wanted(wires: tuple[str, ...], joints: tuple[str, ...]) -> tuple[str, ...]:
    """Columns of a row: time, references, then the signals in the order of `twin.KINDS`."""
    names = ["time", *(f"tension_ref_{w}" for w in wires)]
    return (*names, *(f"{k}_{channel}" for k in KINDS for channel in (joints if k == "angle" else wires)))


@dataclass(frozen=True)
class Columns:
    """A file's columns.

    Attributes:
        source: file. heading: its cells. places: of the wanted columns among them, None where there is none. factors:
        to SI.
    """

    source: str
    heading: tuple[str, ...]
    names: tuple[str, ...]
    places: tuple[int | None, ...]
    factors: np.ndarray

    @property
    def absent(self) -> tuple[str, ...]:
        """Kinds of which the file has no column."""
        there = {n.rsplit("_", 1)[0] for n, place in zip(self.names, self.places) if place is not None}
        return tuple(k for k in KINDS if k not in there)

    def values(self, cells: list[str], row: int) -> np.ndarray:
        """One row [SI], NaN where a cell is empty or has no column. InputError naming file, column and row."""
        if len(cells) != len(self.heading):
            raise InputError(f"{self.source}: row {row} has {len(cells)} cells, the heading has {len(self.heading)}")
        found = [
            nan if place is None else number(cells[place], f"{self.source}: column {name!r}, row {row}")
            for name, place in zip(self.names, self.places)
        ]
        if found[0] != found[0]:
            raise InputError(f"{self.source}: column 'time', row {row}: empty")
        return np.array(found) * self.factors


def number(cell: str, where: str) -> float:
    """A cell's number, NaN if it is empty."""
    if not cell.strip():
        return nan
    try:
        value = float(cell if "_" not in cell else "no number")  # float() takes 1_000, a log must not
    except ValueError:
        raise InputError(f"{where}: {cell[:40]!r} is not a number") from None
    if isinf(value):
        raise InputError(f"{where}: infinite")
    return value


def read_heading(cells: list[str], source: str, wires: tuple[str, ...], joints: tuple[str, ...]) -> Columns:
    """The columns of a heading. InputError for a missing or doubled column and an unknown or unsuitable unit, by
    name."""
    if len(cells) == 1 and ";" in cells[0]:
        raise InputError(f"{source}: cells are separated by ';', wanted ','")
    found: dict[str, tuple[int, float]] = {}
    for place, text in enumerate(cells):
        name, unit = split_heading(text, source)
        if name in found:
            raise InputError(f"{source}: column {name!r} comes twice")
        where = f"{source}, column {name!r}"
        check_unit(name, unit, where)
        found[name] = place, float(to_si(np.ones(1), unit, where)[0])
    names = wanted(wires, joints)
    for name in names:
        if name not in found and (name == "time" or name.rsplit("_", 1)[0] in NEEDED):
            raise InputError(f"{source}: required column {name!r} is missing (found {', '.join(found)})")
    places = tuple(found[n][0] if n in found else None for n in names)
    return Columns(source, tuple(cells), names, places, np.array([found[n][1] if n in found else 1.0 for n in names]))
