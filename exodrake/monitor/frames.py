"""Rows of a growing log set on the grid of frames, as `exodrake.data.clock.regularise` does for a whole one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.clock import STRETCH, other_rate
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
