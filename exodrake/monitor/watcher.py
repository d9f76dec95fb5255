"""Monitor of a log: rows from the file, frames from the rows, residuals from the frames, then gap and alarm."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.data.formats import ending, read_table
from exodrake.data.log import check_columns
from exodrake.monitor.alarm import BEFORE, Alarm, Gap, Reading, date_rise, judge, measure_noise, read_limits
from exodrake.monitor.online_replay import LOOP, OnlineReplay, channels, replayed_segments
from exodrake.monitor.tail import Grid, Rows, Tail, log_columns

BATCH = 500  # frames that the model takes at once, so that a long log shows how far it is
POLL = 0.2  # s between looks at the file


class Monitor:
    """State of the monitor of one log. `push` takes frames and yields a reading for each second."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.machine = robot, (machine := robot.machine)
        self.reading: Reading | None = None  # the last one
        self.alarm: Alarm | None = None  # of the last reading
        self.alarms: list[Alarm] = []  # the first of each episode
        self.notes: list[str] = []  # restarts of the model
        self.frames, self.busy = 0, 0.0  # frames taken, and time spent on them [s]
        self.noise, self.limit, self.channels = measure_noise(robot), read_limits(machine), channels(machine)
        segments = {s.name for s in replayed_segments(machine).values()}
        self.segments = (*(s.name for s in machine.segments if s.name in segments), LOOP)
        self.replay: OnlineReplay | None = None

    def push(self, frames: Rows) -> Iterator[Reading]:
        """Takes more frames; at a restart the model begins anew, at rest."""
        if frames.restart or self.replay is None:
            if frames.note:
                self.notes.append(frames.note)
            self.replay, self.gap = OnlineReplay(self.robot), Gap(self.noise, self.machine.frame)
            self.reading = self.alarm = None
            self.powers: deque[np.ndarray] = deque(maxlen=BEFORE)
        for at in range(0, len(frames.values), BATCH):
            yield from self.advance(frames.values[at : at + BATCH], last=False)

    def end(self) -> Iterator[Reading]:
        """The log ends: the last frames, which waited for smoothing, come out."""
        if self.replay is not None:
            yield from self.advance(np.zeros((0, len(log_columns(self.machine)))), last=True)
            self.replay = None

    def advance(self, rows: np.ndarray, last: bool) -> Iterator[Reading]:
        """Readings that frames (n, columns) [SI] of time, references and compared columns complete."""
        assert self.replay is not None
        began, measured = time.perf_counter(), 1 + self.replay.references
        found = self.gap.push(self.replay.push(rows[:, 1:measured], rows[:, measured:], last))
        self.busy, self.frames = self.busy + time.perf_counter() - began, self.frames + len(rows)
        for reading in found:
            self.reading, before, alarm = reading, self.alarm, None
            self.powers.append(reading.power)
            if self.limit is not None and (alarm := judge(reading, self.channels, self.limit)) is not None:
                powers = np.array(self.powers)[:, self.channels.index(alarm.channel)]
                rose = before.rose if before else date_rise(powers, alarm.second, self.gap.length)
                alarm = alarm._replace(rose=rose)
                self.alarms += [] if before else [alarm]
            self.alarm = alarm
            yield reading

    def rms(self, values: np.ndarray, segment: str) -> float:
        """RMS over a segment's channels of `values` (channels,); NaN if none is measured."""
        own = values[[c.segment == segment for c in self.channels]]
        return float(np.sqrt(np.mean(own[np.isfinite(own)] ** 2))) if np.isfinite(own).any() else float("nan")


def follow(monitor: Monitor, path: Path, idle: float | None) -> Iterator[Reading | None]:
    """Follows a file; yields each reading, and None after every look at the file.

    Args:
        monitor: takes the frames.
        path: file; one that is not CSV is read as it is.
        idle: time without a new row after which the log ends [s]; None: never.

    Raises:
        InputError: for a file that cannot be a log, and for one that did not appear in time.
    """
    grid, wanted = Grid(str(path), monitor.machine.frame), log_columns(monitor.machine)

    def take(rows: Rows) -> Iterator[Reading]:
        for frames in grid.push(rows):
            yield from monitor.push(frames)

    if ending(path) not in (".csv", None) and path.exists():
        log = read_table(path)
        check_columns(log, [name for name, required in wanted.items() if required])
        columns = [log.time, *(log[n] if log.has(n) else np.full(len(log), np.nan) for n in [*wanted][1:])]
        yield from take(Rows(np.column_stack(columns), True, range(1, len(log) + 1)))
        yield from monitor.end()
        return
    tail, changed = Tail(path, monitor.machine), time.monotonic()
    while True:
        for rows in tail.poll():
            yield from take(rows)
            changed = time.monotonic()
        yield None
        if idle is not None and time.monotonic() - changed >= idle:
            break
        time.sleep(POLL if idle is None else min(POLL, max(idle, 0.0)))
    if monitor.replay is None:
        raise InputError(f"{path}: no rows" if path.exists() else f"{path}: no such file")
    yield from monitor.end()
