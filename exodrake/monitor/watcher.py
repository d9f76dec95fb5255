"""Monitor of a growing log: rows from the file, frames from the rows, residuals from the frames, then gap and alarm.

A new log begins where the file shrinks, is replaced by another of its name or repeats its heading.
"""

import io
import os
import time
from codecs import BOM_UTF8
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError, MissingColumn
from exodrake.core.files import refuse_special
from exodrake.data.formats import ending, read_table
from exodrake.data.formats.csv import TextLayout, read_text, split_rows
from exodrake.data.import_log import Mapped, import_recording
from exodrake.data.log import STRETCH, check_columns, columns_in_si, find_first, other_rate
from exodrake.model.machine import Machine
from exodrake.model.robot import Robot
from exodrake.monitor.alarm import BEFORE, Alarm, Gap, Reading, date_rise, judge, measure_noise, read_limits
from exodrake.simulation.segments import LOOP, OnlineReplay, list_channels, replayed_segments

HEAD = 512  # bytes at the start of a file by which it is known again
CHUNK = 1 << 20  # bytes taken at once, so that a long log shows how far it is
BRIDGED = 2.0  # s of missing frames over which the model goes on with the last references
BATCH = 500  # frames that the model takes at once, so that a long log shows how far it is
POLL = 0.2  # s between looks at the file


def log_columns(machine: Machine) -> dict[str, bool]:
    """Columns of a row, and whether a log must have them: time, references, then the compared columns."""
    columns = (*machine.references, *(machine.column(kind) for kind in machine.compared))
    return {"time": True} | {name: column.required for column in columns for name in machine.log_names([column])}


@dataclass(frozen=True)
class Rows:
    """Consecutive rows of a file, or frames."""

    values: np.ndarray  # (n, columns) in the order of `log_columns` [SI], NaN where a sample or a frame is missing
    restart: bool  # whether a log begins, or the model must begin anew
    numbers: Sequence[int] = ()  # of rows of a file, 1 below the heading, empty lines left out
    note: str = ""  # reason of a restart within a file


class Tail:
    """The rows of a file that have come since the last look; of a foreign file by a mapping of names and units."""

    def __init__(self, path: Path, machine: Machine, mapped: Mapped | None = None) -> None:
        self.path, self.wanted, self.mapped = path, log_columns(machine), mapped
        self.layout = mapped or TextLayout()
        if mapped is not None and (  # only what converts each cell for itself, of a table with heading and time
            any(c.filter is not None or c.wrap is not None for c in mapped.columns)
            or any(c.take != "first" or c.minus or c.filter is not None for c in mapped.derived)
            or (mapped.sync or mapped.skip or mapped.time is None or not mapped.heading)
        ):
            raise InputError(
                f"{path}: a growing file is mapped by name, unit, scale, offset, sign, and what to `take: first`; else "
                "`exodrake import`"
            )
        self.firsts = {c.name: c for c in (mapped.derived if mapped else ()) if {c.name, c.of} <= {*self.wanted}}
        self.stream: io.BufferedReader | None = None

    def poll(self) -> Iterator[Rows]:
        """New rows. InputError naming file, column and row for a heading or a row that does not belong to a log."""
        if self.stream is None:
            self.open()
        else:  # begin anew where the file became shorter than what was read of it, or starts with other bytes
            at, end = self.stream.tell(), self.stream.seek(0, io.SEEK_END)
            self.stream.seek(0)
            same = self.stream.read(len(self.head)) == self.head
            self.stream.seek(at)
            if end < at or not same:
                self.open()
        while self.stream is not None:
            if data := self.stream.read(CHUNK):
                yield from self.read(data)
                continue
            try:
                if os.path.samestat(os.stat(self.path), os.fstat(self.stream.fileno())):
                    return
            except OSError:
                return
            self.open()  # another file stands in the place of the open one

    def open(self) -> None:
        """Opens the file at its start if it is there; InputError if it may not be read."""
        refuse_special(self.path)
        if self.stream is not None:
            self.stream.close()
        self.stream, self.heading, self.part, self.head, self.row = None, b"", b"", b"", 0
        try:
            self.stream = open(self.path, "rb")  # noqa: SIM115
        except FileNotFoundError:
            pass
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read ({error.strerror})") from None

    def read(self, data: bytes) -> Iterator[Rows]:
        """Rows of the whole lines so far, cut where the heading comes again."""
        self.head += data[: HEAD - len(self.head)]
        whole, end, self.part = (self.part + data).rpartition(b"\n")
        block: list[bytes] = []
        for line in (whole + end).removeprefix(BOM_UTF8).splitlines(keepends=True):
            if line.strip() and (not self.heading or line.strip() == self.heading.strip()):
                yield from self.convert(block)
                self.begin(line)
                block = []
            else:
                block.append(line)
        yield from self.convert(block)

    def begin(self, heading: bytes) -> None:
        """Finds the columns of a new log; InputError naming a missing one or an unsuitable unit."""
        cells = [cell.strip() for cell in next(split_rows(heading, str(self.path), self.layout), [])]
        if self.mapped is None:
            found, _ = columns_in_si([(cell, np.zeros(0)) for cell in cells], str(self.path))
            there = dict(zip(found, cells, strict=True))
        else:
            foreign = {"time": self.mapped.time} | {column.name: column.of for column in self.mapped.columns}
            there = {name: of for name, of in foreign.items() if of in cells}
        for name, required in self.wanted.items():
            if required and name not in there and name not in self.firsts:
                raise MissingColumn(f"{self.path}: required column {name!r} is missing (found {', '.join(cells)})")
        self.columns = {name: there[name] for name in self.wanted if name in there}
        self.heading, self.held, self.restart = heading, dict[str, float](), True

    def convert(self, block: list[bytes]) -> Iterator[Rows]:
        """Rows [SI] of lines below the heading. InputError naming file, column and row."""
        source, table = str(self.path), dict[str, np.ndarray]()
        if any(map(bytes.strip, block)):
            data = b"".join([self.heading, *block])
            table = read_text(data, source, self.layout, [*self.columns.values()], before=self.row)
        if not (count := len(next(iter(table.values()), ()))):
            return
        pairs = table.items()
        if self.mapped is not None:
            pairs = [(f"time [{self.mapped.time_unit}]", table[self.columns["time"]])]
            pairs += [(f"{c.name} [{c.unit}]", c.sign * (c.scale * table[c.of] + c.offset))
                      for c in self.mapped.columns if c.name in self.columns]  # fmt: skip
        found, _ = columns_in_si(pairs, source, before=self.row)
        if (row := find_first(np.isnan(found["time"]))) is not None:
            raise InputError(f"{source}: column 'time', row {self.row + row + 1}: empty")
        nothing = np.full(count, nan)
        for name, column in self.firsts.items():
            values = found.get(column.of, nothing) * column.scale + column.offset
            known = np.logical_or.accumulate(np.isfinite(values)) | (name in self.held)
            if known.any():
                self.held.setdefault(name, float(values[known.argmax()]))
            found[name] = np.where(known, self.held.get(name, nan), nan)
        values = np.column_stack([found.get(name, nothing) for name in self.wanted])
        yield Rows(values, self.restart, range(self.row + 1, self.row + count + 1))
        self.row, self.restart = self.row + count, False


class Grid:
    """Sorts rows into frames: repeats are dropped, missing frames are NaN, after a long gap the model begins anew."""

    def __init__(self, source: str, frame: float) -> None:
        self.source, self.frame, self.bridged = source, frame, max(BRIDGED, 2.0 * frame)
        self.last: np.ndarray | None = None
        self.stretch: list[tuple[float, int]] = []  # time [s] and frame of the last rows

    def push(self, rows: Rows) -> Iterator[Rows]:
        """Frames of some rows. InputError naming the row for a backward clock or rows faster than the frame."""
        restart, note, found = rows.restart, "", []
        self.last = None if restart else self.last
        for number, row in zip(rows.numbers, rows.values, strict=True):
            steps = 1
            if self.last is not None:
                if np.array_equal(row, self.last, equal_nan=True):
                    continue
                gap = row[0] - self.last[0]
                if gap <= 0:
                    fault = "comes again with other values" if gap == 0 else f"comes after {self.last[0]:g} s"
                    raise InputError(f"{self.source}: column 'time', row {number}: {row[0]:g} s {fault}")
                if (steps := int(np.rint(gap / self.frame))) < 1:
                    raise InputError(
                        f"{self.source}: row {number} comes {gap:.3g} s after the one before, but a frame is "
                        f"{self.frame:g} s"
                    )
            frame = self.stretch[-1][1] + steps if self.stretch and self.last is not None else 0
            self.stretch = [*self.stretch, (row[0], frame)] if frame else [(row[0], 0)]
            if len(self.stretch) == STRETCH:  # some hundred rows show a clock that is fast or slow, or another rate
                other, self.stretch = other_rate(*np.transpose(self.stretch), self.frame), []
                if other is not None:
                    raise InputError(
                        f"{self.source}: from {other[0]:g} s on a frame takes {other[1] * 1e3:.4g} ms by its clock, "
                        f"not {self.frame * 1e3:g} ms"
                    )
            if self.last is not None and (steps - 1) * self.frame > self.bridged:
                if found:
                    yield Rows(np.array(found), restart, note=note)
                restart, found = True, []
                note = f"no rows for {row[0] - self.last[0]:.1f} s at {self.last[0]:.2f} s: the model begins anew"
            else:
                found += [np.full(len(row), np.nan)] * (steps - 1)
            found.append(row)
            self.last = row
        if found:
            yield Rows(np.array(found), restart, note=note)


class Monitor:
    """State of the monitor of one log. `push` takes frames and yields a reading for each second."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.machine = robot, robot.machine
        self.reading: Reading | None = None  # the last one
        self.alarm: Alarm | None = None  # of the last reading
        self.alarms: list[Alarm] = []  # the first of each episode
        self.notes: list[str] = []  # restarts of the model
        self.frames, self.busy = 0, 0.0  # frames taken, and time spent on them [s]
        self.noise, self.limit = measure_noise(robot), read_limits(self.machine)
        self.channels = list_channels(self.machine)
        replayed = list(replayed_segments(self.machine).values())
        self.segments = (*(s.name for s in self.machine.segments if s in replayed), LOOP)
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


def follow(monitor: Monitor, path: Path, idle: float | None, mapped: Mapped | None = None) -> Iterator[Reading | None]:
    """Follows a file, which is read as it is if it is no CSV; yields each reading, and None after every look at it.

    The log ends after an `idle` time without a new row [s]; None: never. InputError for a file that cannot be a log,
    and for one that did not appear in time.
    """
    grid, wanted = Grid(str(path), monitor.machine.frame), log_columns(monitor.machine)

    def take(rows: Rows) -> Iterator[Reading]:
        for frames in grid.push(rows):
            yield from monitor.push(frames)

    if ending(path) not in (".csv", None) and path.exists():
        log = read_table(path) if mapped is None else import_recording(path, mapped).log
        check_columns(log, [name for name, required in wanted.items() if required])
        columns = [log.time, *(log[n] if log.has(n) else np.full(len(log), np.nan) for n in [*wanted][1:])]
        yield from take(Rows(np.column_stack(columns), True, range(1, len(log) + 1)))
        yield from monitor.end()
        return
    tail, changed = Tail(path, monitor.machine, mapped), time.monotonic()
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
