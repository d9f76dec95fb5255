"""A robot's model beside its growing log: in closed loop, and each segment replayed from measured inputs.

Each compared column is a channel of residuals against the closed loop, and one against its segment's replay. The result
does not depend on how the stream of rows is cut.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.compiled.inputs import NOTHING, NoiseInputs, input_rows, prepared, reading_places, reference_width
from exodrake.compiled.run import Replay
from exodrake.core.machine import Machine, Segment, signal_count
from exodrake.core.robot import Robot
from exodrake.simulation.simulate import cubic

LOOP = "loop"
WINDOW, ORDER = 7, 2  # frames and order of the Savitzky-Golay filter that smooths what is fed in


@dataclass(frozen=True)
class Channel:
    """A column of residuals: `segment` (or `LOOP`), kind of log column, and channel of that kind."""

    segment: str
    kind: str
    channel: str

    @property
    def column(self) -> str:
        """Column of the log."""
        return f"{self.kind}_{self.channel}"


def replayed_segments(machine: Machine) -> dict[str, Segment]:
    """Column kind -> segment that ends in it; empty where a single segment is the closed loop itself."""
    found = {s.output: s for s in machine.segments if s.output in machine.compared}
    return found if len(found) > 1 else {}


def compared_columns(machine: Machine) -> tuple[tuple[str, str], ...]:
    """Kind and channel of each compared column."""
    return tuple((k, c) for k in machine.compared for c in machine.channels(machine.column(k).signal))


def channels(machine: Machine) -> tuple[Channel, ...]:
    """All channels: against the closed loop, then against the replays."""
    columns, segments = compared_columns(machine), replayed_segments(machine)
    loop = tuple(Channel(LOOP, kind, channel) for kind, channel in columns)
    return loop + tuple(Channel(segments[kind].name, kind, channel) for kind, channel in columns if kind in segments)


LAG = WINDOW // 2  # frames by which smoothing lags
AHEAD = 2  # frames that interpolation between samples looks ahead
MEMORY = 1000  # frames that a delayed sample may lie back


class Hold:
    """A missing sample (NaN) keeps the last value known, 0 before any is."""

    def __init__(self, channels: int) -> None:
        self.held = np.zeros(channels)

    def push(self, rows: np.ndarray) -> np.ndarray:
        """Rows (n, channels) without gaps."""
        out = rows.copy()
        if not np.isfinite(out).all():
            for row in out:
                row[:] = np.where(np.isfinite(row), row, self.held)
                self.held = row.copy()
        elif len(out):
            self.held = out[-1].copy()
        return out


class Delay:
    """Rows that come out some frames later."""

    def __init__(self, channels: int, frames: int) -> None:
        self.waiting, self.frames = np.zeros((0, channels)), frames

    def push(self, rows: np.ndarray, last: bool) -> np.ndarray:
        """Takes rows (n, channels); returns those whose time has come, all of them at the end of the log."""
        whole = np.concatenate([self.waiting, rows])
        count = len(whole) if last else max(len(whole) - self.frames, 0)
        self.waiting = whole[count:]
        return whole[:count]


class Smoother:
    """Savitzky-Golay filter of rows without gaps, and its derivative; the ends are held.

    Sums run in one order however the stream is cut.
    """

    def __init__(self, frame: float) -> None:
        from scipy.signal import savgol_coeffs

        self.value = savgol_coeffs(WINDOW, ORDER, use="dot")
        self.rate = savgol_coeffs(WINDOW, ORDER, deriv=1, delta=frame, use="dot")
        self.tail: np.ndarray | None = None

    def push(self, rows: np.ndarray, last: bool) -> tuple[np.ndarray, np.ndarray]:
        """Takes rows (n, channels); returns values and rates [1/s] of those `LAG` back, of all at the log's end."""
        if self.tail is None:
            if not len(rows):
                return rows, rows
            self.tail = np.repeat(rows[:1], LAG, axis=0)
        whole = np.concatenate([self.tail, rows])
        if last:
            whole = np.concatenate([whole, np.repeat(whole[-1:], LAG, axis=0)])
        count = max(len(whole) - 2 * LAG, 0)
        self.tail = whole[count:]
        return weighted(self.value, whole, count), weighted(self.rate, whole, count)


def weighted(weights: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray:
    """Weighted sums (count, channels) of `count` windows of rows."""
    total = np.zeros((count, rows.shape[1]))
    for k, weight in enumerate(weights):
        total += weight * rows[k : k + count]
    return total


class DelayedSamples:
    """Compared columns of a simulated log; where a column has a delay, its samples show the past.

    Rows come out `ahead` frames later, since interpolation looks ahead; at once on a machine without delays.
    """

    def __init__(self, machine: Machine) -> None:
        at, self.frame, self.places, self.late = machine.offsets, machine.frame, [], []
        for kind in machine.compared:
            column, width = machine.column(kind), machine.column_width(kind)
            if column.delay:
                self.late.append((slice(len(self.places), len(self.places) + width), at[column.delay.signal].start))
            self.places += range(at[column.signal].start, at[column.signal].stop)
        self.ahead = AHEAD if self.late else 0
        self.rows, self.first, self.done = np.zeros((0, signal_count(machine))), 0, 0

    def push(self, record: np.ndarray, last: bool) -> np.ndarray:
        """Takes signals (n, signals) of the next frames; returns (m, compared columns) [SI]."""
        if not self.late:
            return record[:, self.places]
        self.rows = np.concatenate([self.rows, record])
        end = self.first + len(self.rows) - (0 if last else self.ahead)
        here = np.arange(self.done, max(end, self.done)) - self.first
        seen = self.rows[here][:, self.places]
        for columns, delay in self.late:
            back = self.rows[here, delay] / self.frame
            if back.any():
                seen[:, columns] = cubic(self.rows[:, self.places[columns]], here - back)
        self.done += len(here)
        drop = max(len(self.rows) - MEMORY, 0)
        self.rows, self.first = self.rows[drop:], self.first + drop
        return seen


ANCHOR = 10.0  # s, time constant with which an integrating segment is drawn to its measured output
EASE = 0.9  # a log may begin in motion: the first gain is 1, each further one this share of the last, down to ANCHOR's


def silent(robot: Robot) -> np.ndarray:
    """Flat parameters without noise and rounding."""
    values = prepared(robot, quantisation=False)
    for name in robot.machine.noise:
        values[robot.machine.index[name]] = 0.0
    return values


class SegmentReplay:
    """One segment simulated while all the others are fixed; the observer's one is drawn to its measured output."""

    def __init__(self, robot: Robot, segment: Segment) -> None:
        machine = self.machine = robot.machine
        others = [s.name for s in machine.segments if s is not segment and not s.exact]
        self.segment, self.replay = segment, Replay(machine, silent(robot), others)
        self.places = reading_places(machine)
        observer = machine.observer
        self.drawn = observer is not None and observer.output == segment.output
        self.known = np.zeros(machine.column_width(segment.output))

    def push(
        self, inputs: list[np.ndarray], feed: np.ndarray, rate: np.ndarray, held: np.ndarray, measured: np.ndarray
    ) -> np.ndarray:
        """Signals (n, signals) [SI] of the next n frames.

        Args:
            inputs: exogenous inputs, (n, channels) each [SI].
            feed: (n, feeds) smoothed outputs of all segments [SI].
            rate: (n, feeds) their rates [SI/s].
            held: (n, compared columns) measured, the last known value where a sample is missing [SI].
            measured: (n, compared columns), NaN where a sample is missing [SI].
        """
        targets, gains = NOTHING, NOTHING
        if self.drawn:
            targets = measured[:, self.places[self.segment.output]]
            gains = self.gains(np.isfinite(targets))
        return self.replay.step(inputs, feed, rate, self.readings(held, measured), targets, gains)

    def readings(self, held: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Inputs and outputs of exact segments (n, compared columns); NaN where the simulated value stays."""
        found = np.full_like(measured, np.nan)
        for software in (s for s in self.machine.segments if s.exact):
            for kind in software.inputs:
                found[:, self.places[kind]] = held[:, self.places[kind]]
            if software is not self.segment:
                found[:, self.places[software.output]] = measured[:, self.places[software.output]]
        found[:, self.places[self.segment.output]] = np.nan
        return found

    def gains(self, known: np.ndarray) -> np.ndarray:
        """Share of the difference by which each frame moves the observer's state, for frames (n, channels) known."""
        before = self.known + np.cumsum(known, axis=0) - known
        self.known = self.known + known.sum(axis=0)
        return np.maximum(EASE**before, self.machine.frame / ANCHOR)


class OnlineReplay:
    """Residuals of a robot from the start of its log on."""

    def __init__(self, robot: Robot) -> None:
        machine = self.machine = robot.machine
        self.channels, self.references = channels(machine), reference_width(machine)
        self.columns = len(compared_columns(machine))
        places = reading_places(machine)
        self.fed = [i for s in machine.segments for i in range(places[s.output].start, places[s.output].stop)]
        self.loop = Replay(machine, silent(robot))
        self.segments = {k: SegmentReplay(robot, s) for k, s in replayed_segments(machine).items()}
        self.hold_reference, self.hold, self.smooth = Hold(self.references), Hold(self.columns), Smoother(machine.frame)
        self.rows = Delay(self.references + 2 * self.columns, LAG)
        self.seen = {k: DelayedSamples(machine) for k in ("", *self.segments)}
        self.measured = Delay(2 * self.columns, self.seen[""].ahead)
        self.known = np.zeros(self.columns, dtype=bool)

    def push(self, reference: np.ndarray, measured: np.ndarray, last: bool = False) -> np.ndarray:
        """Residuals of the frames whose time has come: they lag by a few frames of smoothing and interpolation.

        Args:
            reference: (n, references) of the next n frames [SI].
            measured: (n, compared columns), NaN where a sample is missing [SI].
            last: whether the log ends, so that the frames that wait come out too.

        Returns:
            (m, channels) measured - simulated [SI], NaN where the sample, or an input of its replay, is missing.
        """
        held = self.hold.push(measured)
        feed, rate = self.smooth.push(held[:, self.fed], last)
        rows = self.rows.push(np.concatenate([self.hold_reference.push(reference), held, measured], axis=1), last)
        references, held, was = np.split(rows, [self.references, self.references + self.columns], axis=1)
        inputs = list(input_rows(self.machine, references, NoiseInputs.draw(len(rows), None, self.machine)).values())
        usable = self.usable(was)
        both = self.measured.push(np.concatenate([was, np.where(usable, was, np.nan)], axis=1), last)
        was, judged = np.split(both, 2, axis=1)
        found = [was - self.seen[""].push(self.loop.step(inputs), last)]
        for kind, at in reading_places(self.machine).items():
            if kind in self.segments:
                record = self.segments[kind].push(inputs, feed, rate, held, rows[:, -self.columns :])
                found.append((judged - self.seen[kind].push(record, last))[:, at])
        return np.concatenate(found, axis=1)

    def usable(self, measured: np.ndarray) -> np.ndarray:
        """Mask of the compared columns whose replay had its inputs, in this frame and in the one before."""
        here, places = np.isfinite(measured), reading_places(self.machine)
        both = here & np.concatenate([self.known[None], here[:-1]])[: len(here)]
        self.known = here[-1] if len(here) else self.known
        found = np.ones_like(both)
        for kind, replay in self.segments.items():
            for needed in replay.segment.inputs:
                found[:, places[kind]] &= both[:, places[needed]].all(axis=1)[:, None]
        return found
