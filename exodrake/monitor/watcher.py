"""Follows a log: lines from the file, frames from the lines, residuals from the frames, the gap from the residuals, an
alarm from the gap."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.data.formats import ending
from exodrake.data.log_file import read_table
from exodrake.monitor.alarm import Alarm, judge, limits
from exodrake.monitor.columns import read_heading
from exodrake.monitor.companion import LOOP, SEGMENTS, Companion, channels
from exodrake.monitor.frames import Grid, Stretch
from exodrake.monitor.gap import Gap, Reading, floors
from exodrake.monitor.tail import Piece, Tail

PIECE = 500  # frames that the model takes at once, so that a long log shows how far it is
WATCHED = ("exo_index",)  # machines whose segments `live.segments` knows
POLL = 0.2  # s between looks at the file
BLOCKS = (*sorted(set(SEGMENTS.values()), key=["controller", "motor", "tendon", "finger"].index), LOOP)


@dataclass
class Watch:
    """What is known so far. `push` takes stretches of frames and yields a reading for each second of the log."""

    robot: Robot
    floor: np.ndarray = field(init=False)
    reading: Reading | None = None
    alarm: Alarm | None = None
    alarms: list[Alarm] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    frames: int = 0
    busy: float = 0.0

    def __post_init__(self) -> None:
        if self.robot.machine.name not in WATCHED:
            raise InputError(
                f"{self.robot.source}: {self.robot.machine.name} cannot be watched, only {', '.join(WATCHED)}"
            )
        self.floor, self.limit, self.listed = floors(self.robot), limits(self.robot), channels(self.robot)
        self.companion: Companion | None = None

    def begin(self, note: str) -> None:
        """The model begins anew, at rest."""
        if note:
            self.notes.append(note)
        self.companion, self.gap = Companion(self.robot), Gap(self.floor, self.robot.machine.frame)
        self.reading = self.alarm = None

    def push(self, stretch: Stretch) -> Iterator[Reading]:
        """More frames."""
        if stretch.fresh or self.companion is None:
            self.begin(stretch.note)
        for at in range(0, len(stretch.rows), PIECE):
            yield from self.advance(stretch.rows[at : at + PIECE], last=False)

    def end(self) -> Iterator[Reading]:
        """No more frames will come: the last ones, which waited for smoothing."""
        if self.companion is not None:
            yield from self.advance(np.zeros((0, 16)), last=True)
            self.companion = None

    def advance(self, rows: np.ndarray, last: bool) -> Iterator[Reading]:
        """Frames (n, 16): time, references, signals."""
        assert self.companion is not None
        began = time.perf_counter()
        found = self.gap.push(self.companion.push(rows[:, 1:4], rows[:, 4:], last))
        self.busy, self.frames = self.busy + time.perf_counter() - began, self.frames + len(rows)
        for reading in found:
            self.reading, before = reading, self.alarm
            self.alarm = judge(reading, self.listed, self.limit)
            if self.alarm is not None and before is None:
                self.alarms.append(self.alarm)
            yield reading

    def block(self, values: np.ndarray, name: str) -> float:
        """RMS of a block's channels from those of channels (24,); NaN if none is measured."""
        own = values[[c.segment == name for c in self.listed]]
        return float(np.sqrt(np.mean(own[np.isfinite(own)] ** 2))) if np.isfinite(own).any() else float("nan")


def follow(watch: Watch, path: Path, idle: float | None) -> Iterator[Reading | None]:
    """Follows a file; yields each reading, and None after every look at the file.

    idle: seconds without a new row after which it ends; None: never. A log that is no CSV is read as it is. InputError
    for a file that cannot be a log, and for one that did not appear in time.
    """
    axes, grid = watch.robot.machine.axes, Grid(str(path), watch.robot.machine.frame)
    if ending(path) not in (".csv", None) and path.exists():
        yield from take(watch, grid, whole(path, axes.tendons, axes.joints))
        yield from watch.end()
        return
    tail, quiet = Tail(path, axes.tendons, axes.joints), time.monotonic()
    while True:
        for piece in tail.poll():
            yield from take(watch, grid, piece)
            quiet = time.monotonic()
        yield None
        if idle is not None and time.monotonic() - quiet >= idle:
            break
        time.sleep(POLL if idle is None else min(POLL, max(idle, 0.0)))
    if watch.companion is None:
        raise InputError(f"{path}: no rows" if path.exists() else f"{path}: no such file")
    yield from watch.end()


def take(watch: Watch, grid: Grid, piece: Piece) -> Iterator[Reading]:
    """Readings that a piece of the log completes."""
    for stretch in grid.push(piece):
        yield from watch.push(stretch)


def whole(path: Path, wires: tuple[str, ...], joints: tuple[str, ...]) -> Piece:
    """A log of any known format as one piece."""
    log = read_table(path)
    heading = ["time [s]", *(f"{name} [{log.units[name]}]" for name in log.columns)]
    columns = read_heading(heading, str(path), wires, joints)
    rows = [
        np.full(len(log), np.nan) if place is None else log[name] for name, place in zip(columns.names, columns.places)
    ]
    return Piece(np.column_stack(rows), 1, True)
