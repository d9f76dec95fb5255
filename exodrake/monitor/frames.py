"""Rows of a growing log set on the grid of frames, as `exodrake.data.clock.regularise` does for a whole one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError
from exodrake.monitor.tail import Rows

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
