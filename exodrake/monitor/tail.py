"""A CSV log that still grows: its whole lines as they come, across pauses, truncation and rotation.

The reader waits for a file that does not exist yet, and for the end of an incomplete last line. A new log begins where
the file shrinks, is replaced by another of its name or repeats its heading: its writer has started again.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.files import refuse_special
from exodrake.core.machine import Machine
from exodrake.monitor.columns import Columns, read_heading

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
