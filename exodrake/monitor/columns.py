"""The heading of a growing log: which cell holds which signal, and in which unit."""

from __future__ import annotations

from dataclasses import dataclass
from math import isinf, nan

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.core.units import check_unit, to_si
from exodrake.data.log import refuse_separator, split_heading


def wanted(machine: Machine) -> dict[str, bool]:
    """Columns of a row, and whether a log must have them: time, references, then the compared columns."""
    columns = (*machine.references, *(machine.column(kind) for kind in machine.compared))
    return {"time": True} | {name: column.required for column in columns for name in machine.log_names([column])}


@dataclass(frozen=True)
class Columns:
    """Columns of a file.

    Attributes:
        source: name of the file.
        heading: its cells.
        names: wanted columns, in the order of a row.
        places: their indices in the heading, None for a column that the file lacks.
        factors: (columns,) factors to SI.
    """

    source: str
    heading: tuple[str, ...]
    names: tuple[str, ...]
    places: tuple[int | None, ...]
    factors: np.ndarray

    def values(self, cells: list[str], row: int) -> np.ndarray:
        """One row (columns,) [SI], NaN where a cell is empty or missing. InputError naming file, column and row."""
        if len(cells) != len(self.heading):
            raise InputError(f"{self.source}: row {row} has {len(cells)} cells, the heading has {len(self.heading)}")
        found = [
            nan if place is None else parse(cells[place], f"{self.source}: column {name!r}, row {row}")
            for name, place in zip(self.names, self.places)
        ]
        if found[0] != found[0]:
            raise InputError(f"{self.source}: column 'time', row {row}: empty")
        return np.array(found) * self.factors


def parse(cell: str, where: str) -> float:
    """Number in a cell, NaN if it is empty."""
    if not cell.strip():
        return nan
    try:
        value = float(cell if "_" not in cell else "text")  # float() takes 1_000, a log must not
    except ValueError:
        raise InputError(f"{where}: {cell[:40]!r} is not a number") from None
    if isinf(value):
        raise InputError(f"{where}: infinite")
    return value


def read_heading(cells: list[str], source: str, machine: Machine) -> Columns:
    """The columns of a heading; InputError naming a missing or doubled column or an unsuitable unit."""
    refuse_separator(cells, source)
    found: dict[str, tuple[int, float]] = {}
    for place, text in enumerate(cells):
        name, unit = split_heading(text, source)
        if name in found:
            raise InputError(f"{source}: column {name!r} comes twice")
        where = f"{source}, column {name!r}"
        check_unit(name, unit, where)
        found[name] = place, float(to_si(np.ones(1), unit, where)[0])
    names = wanted(machine)
    for name, required in names.items():
        if required and name not in found:
            raise InputError(f"{source}: required column {name!r} is missing (found {', '.join(found)})")
    places = tuple(found[n][0] if n in found else None for n in names)
    return Columns(source, tuple(cells), tuple(names), places, np.array([found.get(n, (0, 1.0))[1] for n in names]))
