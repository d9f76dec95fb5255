"""A CSV log that still grows, on the grid of frames: its whole lines as they come.

The reader waits for a file that does not exist yet, and for the end of an incomplete last line. A new log begins where
the file shrinks, is replaced by another of its name or repeats its heading: its writer has started again. `Grid` sets
the rows on frames, as `exodrake.data.log.regularise` does for a whole log.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator
from dataclasses import dataclass
from math import isinf, nan
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import refuse_special
from exodrake.core.machine import Machine
from exodrake.core.units import check_unit, to_si
from exodrake.data.log import STRETCH, other_rate, refuse_separator, split_heading


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


HEAD = 512  # bytes at the start of a file by which it is known again
MOST = 1 << 20  # bytes taken at once, so that a long log shows how far it is


@dataclass(frozen=True)
class Rows:
    """Consecutive rows of a file.

    Attributes:
        values: (n, columns) in the order of `Columns` [SI].
        first: number of the first row, 1 below the heading, empty lines included.
        restart: whether a log begins.
    """

    values: np.ndarray
    first: int
    restart: bool


class Tail:
    """The lines of a file that have come since the last look."""

    def __init__(self, path: Path, machine: Machine) -> None:
        self.path, self.machine = path, machine
        self.stream: io.BufferedReader | None = None
        self.forget()

    def forget(self) -> None:
        """Forgets what is known of the file."""
        if self.stream is not None:
            self.stream.close()
        self.columns: Columns | None = None
        self.stream, self.part, self.head, self.row, self.restart = None, b"", b"", 0, True

    def poll(self) -> Iterator[Rows]:
        """New rows. InputError naming file, column and row for a heading or a row that does not belong to a log."""
        if self.stream is not None and self.rewritten():
            self.forget()
        if self.stream is None:
            self.open()
        while self.stream is not None:
            data = self.stream.read(MOST)
            if data:
                yield from self.taken(data)
            elif self.replaced():
                self.forget()
                self.open()
            else:
                return

    def open(self) -> None:
        """Opens the file if it is there; InputError if it may not be read."""
        refuse_special(self.path)
        try:
            self.stream = open(self.path, "rb")  # noqa: SIM115
        except FileNotFoundError:
            self.stream = None
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read ({error.strerror})") from None

    def rewritten(self) -> bool:
        """Whether the open file became shorter than what was read of it, or starts with other bytes."""
        assert self.stream is not None
        at = self.stream.tell()
        if self.stream.seek(0, io.SEEK_END) < at:
            return True
        self.stream.seek(0)
        same = self.stream.read(len(self.head)) == self.head
        self.stream.seek(at)
        return not same

    def replaced(self) -> bool:
        """Whether another file stands in the place of the open one."""
        assert self.stream is not None
        try:
            there = os.stat(self.path)
        except OSError:
            return False
        return not os.path.samestat(there, os.fstat(self.stream.fileno()))

    def taken(self, data: bytes) -> Iterator[Rows]:
        """Rows of the whole lines so far, cut where the heading comes again."""
        if len(self.head) < HEAD:
            self.head += data[: HEAD - len(self.head)]
        whole, end, self.part = (self.part + data).rpartition(b"\n")
        if not end:
            return
        found: list[np.ndarray] = []
        first = self.row + 1
        for cells in self.cells(whole):
            if self.columns is None or tuple(cells) == self.columns.heading:
                if found:
                    yield self.rows(found, first)
                self.columns, found, first = read_heading(cells, str(self.path), self.machine), [], self.row + 1
                self.restart = True
                continue
            self.row += 1
            if cells:
                found.append(self.columns.values(cells, self.row))
                continue
            if found:  # an empty line counts, so that a row is named by its place in the file
                yield self.rows(found, first)
            found, first = [], self.row + 1
        if found:
            yield self.rows(found, first)

    def rows(self, found: list[np.ndarray], first: int) -> Rows:
        """Rows with the mark of a new log, which holds for the first of them only."""
        restart, self.restart = self.restart, False
        return Rows(np.array(found), first, restart)

    def cells(self, lines: bytes) -> Iterator[list[str]]:
        """Cells of whole lines; InputError for bytes that are not text."""
        try:
            text = lines.decode("utf-8-sig")
            yield from csv.reader(io.StringIO(text, newline=""), strict=True)
        except UnicodeDecodeError:
            raise InputError(
                f"{self.path}: not a text file near row {self.row + 1}; a growing log must be CSV"
            ) from None
        except csv.Error as error:
            raise InputError(f"{self.path}: not a CSV file near row {self.row + 1} ({error})") from None


BRIDGED = 2.0  # s of missing frames over which the model goes on with the last references


@dataclass(frozen=True)
class Frames:
    """Consecutive frames.

    Attributes:
        values: (n, columns) [SI], NaN where a frame is missing.
        restart: whether the model must begin anew.
        note: reason of a restart within a file.
    """

    values: np.ndarray
    restart: bool
    note: str = ""


class Grid:
    """Sorts rows into frames.

    Repeated rows are dropped, missing frames become NaN, and after a long gap the model begins anew.
    """

    def __init__(self, source: str, frame: float) -> None:
        self.source, self.frame, self.bridged = source, frame, max(BRIDGED, 2.0 * frame)
        self.last: np.ndarray | None = None
        self.stretch: list[tuple[float, int]] = []  # time [s] and frame of the last rows
        self.missing = self.repeated = 0

    def push(self, rows: Rows) -> Iterator[Frames]:
        """Frames of some rows. InputError naming the row for a backward clock or rows faster than the frame."""
        restart, note, found = rows.restart, "", []
        if restart:
            self.last = None
        for offset, row in enumerate(rows.values):
            steps = self.steps(row, rows.first + offset)
            if steps == 0:
                self.repeated += 1
                continue
            self.check_rate(row[0], steps)
            if (steps - 1) * self.frame > self.bridged:
                if found:
                    yield Frames(np.array(found), restart, note)
                assert self.last is not None
                restart, found = True, []
                note = f"no rows for {row[0] - self.last[0]:.1f} s at {self.last[0]:.2f} s: the model begins anew"
            else:
                self.missing += steps - 1
                found += [np.full(len(row), np.nan)] * (steps - 1)
            found.append(row)
            self.last = row
        if found:
            yield Frames(np.array(found), restart, note)

    def check_rate(self, time: float, steps: int) -> None:
        """InputError where some hundred rows show a clock that is fast or slow, or a log of another rate."""
        number = self.stretch[-1][1] + steps if self.stretch and self.last is not None else 0
        self.stretch = [*self.stretch, (time, number)] if number else [(time, 0)]
        if len(self.stretch) < STRETCH:
            return
        times, numbers = np.transpose(self.stretch)
        found, self.stretch = other_rate(times, numbers, self.frame), []
        if found is not None:
            raise InputError(
                f"{self.source}: from {found[0]:g} s on a frame takes {found[1] * 1e3:.4g} ms by its clock, not "
                f"{self.frame * 1e3:g} ms"
            )

    def steps(self, values: np.ndarray, row: int) -> int:
        """Frames since the last row: 1 for the next and for the first, 0 for the same row again."""
        if self.last is None:
            return 1
        if np.array_equal(values, self.last, equal_nan=True):
            return 0
        gap = values[0] - self.last[0]
        if gap <= 0:
            fault = "comes again with other values" if gap == 0 else f"comes after {self.last[0]:g} s"
            raise InputError(f"{self.source}: column 'time', row {row}: {values[0]:g} s {fault}")
        steps = int(np.rint(gap / self.frame))
        if steps < 1:
            raise InputError(
                f"{self.source}: row {row} comes {gap:.3g} s after the one before, but a frame is {self.frame:g} s"
            )
        return steps
