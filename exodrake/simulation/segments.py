"""A robot's model beside its growing log: in closed loop, and each segment replayed from measured inputs.

Each compared column is a channel of residuals against the closed loop, and one against its segment's replay. The result
does not depend on how the stream of rows is cut.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from exodrake.data.log import fill_columns
from exodrake.engine.inputs import NoiseInputs, RunOptions, input_rows, prepare_values, reading_places, reference_width
from exodrake.engine.run import Replay
from exodrake.model.machine import Machine, Segment, signal_count
from exodrake.model.robot import Robot
from exodrake.simulation.simulate import delay_columns

LOOP = "loop"
WINDOW, ORDER = 7, 2  # frames and order of the Savitzky-Golay filter that smooths what is fed in
LAG = WINDOW // 2  # frames by which smoothing lags
AHEAD = 2  # frames that interpolation between delayed samples looks ahead
MEMORY = 1000  # frames that a delayed sample may lie back
ANCHOR = 10.0  # s, time constant with which an integrating segment is drawn to its measured output
EASE = 0.9  # a log may begin in motion: the first gain is 1, each further one this share of the last, down to ANCHOR's


class Channel(NamedTuple):
    """A column of residuals: `segment` (or `LOOP`), kind of log column, and the column."""

    segment: str
    kind: str
    column: str


def replayed_segments(machine: Machine) -> dict[str, Segment]:
    """Column kind -> segment that ends in it; empty where a single segment is the closed loop itself."""
    found = {s.output: s for s in machine.segments if s.output in machine.compared}
    return found if len(found) > 1 else {}


def list_channels(machine: Machine) -> tuple[Channel, ...]:
    """All channels: against the closed loop, then against the replays."""
    kinds = [(kind, name) for kind in machine.compared for name in machine.log_names([machine.column(kind)])]
    segments = replayed_segments(machine)
    replayed = (Channel(segments[kind].name, kind, name) for kind, name in kinds if kind in segments)
    return *(Channel(LOOP, kind, name) for kind, name in kinds), *replayed


class Buffer:
    """Rows of a stream, each of which comes out with some before it once `ahead` more are there."""

    def __init__(self, back: int, ahead: int) -> None:
        self.back, self.ahead, self.done = back, ahead, 0
        self.rows: np.ndarray | None = None

    def push(self, rows: np.ndarray, last: bool) -> tuple[np.ndarray, slice]:
        """Takes rows; returns rows with their neighbours, and which of them come out: all at the log's end."""
        rows = rows if self.rows is None else np.concatenate([self.rows, rows])
        ready = slice(self.done, max(len(rows) - (0 if last else self.ahead), self.done))
        drop = max(ready.stop - self.back, 0)
        self.rows, self.done = rows[drop:], ready.stop - drop
        return rows, ready


class SegmentReplay:
    """One segment simulated while all the others are fixed; the observer's one is drawn to its measured output."""

    def __init__(self, robot: Robot, segment: Segment) -> None:
        machine = self.machine = robot.machine
        others = [s.name for s in machine.segments if s is not segment and not s.exact]
        self.segment, self.replay = segment, Replay(machine, without_noise(robot), others)
        self.places, observer = reading_places(machine), machine.observer
        self.drawn = observer is not None and observer.output == segment.output
        self.known = np.zeros(machine.column_width(segment.output))

    def push(
        self, inputs: list[np.ndarray], feed: np.ndarray, rate: np.ndarray, held: np.ndarray, measured: np.ndarray
    ) -> np.ndarray:
        """Signals (n, signals) of the next n frames, by exogenous inputs (n, channels) each, all in SI.

        feed, rate: (n, feeds) smoothed outputs of all segments and their rates. held, measured: (n, compared columns),
        the last known value where a sample is missing, and NaN there.
        """
        readings = np.full_like(measured, np.nan)  # of exact segments; NaN where the simulated value stays
        for software in (s for s in self.machine.segments if s.exact):
            for kind in software.inputs:
                readings[:, self.places[kind]] = held[:, self.places[kind]]
            if software is not self.segment:
                readings[:, self.places[software.output]] = measured[:, self.places[software.output]]
        own = self.places[self.segment.output]
        readings[:, own] = np.nan
        options = RunOptions(feed=feed, rate=rate, readings=readings)
        if not self.drawn:
            return self.replay.step(inputs, options)
        known = np.isfinite(measured[:, own])
        before = self.known + np.cumsum(known, axis=0) - known
        self.known = self.known + known.sum(axis=0)
        gains = np.maximum(EASE**before, self.machine.frame / ANCHOR)
        return self.replay.step(inputs, options._replace(targets=measured[:, own], gains=gains))


def without_noise(robot: Robot) -> np.ndarray:
    """Flat parameters without noise and rounding."""
    values = prepare_values(robot, quantisation=False)
    values[[robot.machine.index[name] for name in robot.machine.noise]] = 0.0
    return values


class OnlineReplay:
    """Residuals of a robot from the start of its log on."""

    def __init__(self, robot: Robot) -> None:
        machine = self.machine = robot.machine
        self.references, self.places = reference_width(machine), reading_places(machine)
        self.columns = sum(machine.column_width(kind) for kind in machine.compared)
        self.fed = [i for s in machine.segments for i in range(self.columns)[self.places[s.output]]]
        self.loop, segments = Replay(machine, without_noise(robot)), replayed_segments(machine)
        self.segments = {k: SegmentReplay(robot, segments[k]) for k in machine.compared if k in segments}
        self.held = np.zeros((1, self.references + self.columns))
        every, at = range(signal_count(machine)), machine.offsets
        self.indices = [i for kind in machine.compared for i in every[at[machine.column(kind).signal]]]
        late = any(machine.column(kind).delay for kind in machine.compared)
        self.frames, self.measured = Buffer(LAG, LAG), Buffer(0, AHEAD * late)
        self.simulated = Buffer(MEMORY * late, AHEAD * late)

    def push(self, reference: np.ndarray, measured: np.ndarray, last: bool = False) -> np.ndarray:
        """Residuals of the frames whose time has come: they lag by a few frames of smoothing and interpolation.

        Args:
            reference: (n, references) of the next n frames [SI].
            measured: (n, compared columns), NaN where a sample is missing [SI].
            last: whether the log ends, so that the frames that wait come out too.

        Returns:
            (m, channels) measured - simulated [SI], NaN where the sample, or an input of its replay, is missing.
        """
        machine, n = self.machine, self.references
        # a missing sample keeps the last value known, 0 before any is
        filled = fill_columns(np.concatenate([self.held, np.hstack([reference, measured])]))
        self.held = filled[-1:]
        both, ready = self.frames.push(np.hstack([filled[1:], measured]), last)
        references, held, was = np.split(both, [n, n + self.columns], axis=1)
        smooth = partial(savgol_filter, held[:, self.fed], WINDOW, ORDER, axis=0, mode="nearest")
        feed, rate = np.asarray(smooth())[ready], np.asarray(smooth(deriv=1, delta=machine.frame))[ready]
        references, held, raw = references[ready], held[ready], was[ready]
        known, judged = np.isfinite(was), was.copy()
        known[1:], known[:1] = known[1:] & known[:-1], False  # a replay needs its inputs a frame before, too
        for kind, replay in self.segments.items():
            needed = [self.places[name] for name in replay.segment.inputs]
            judged[~np.all([known[:, place].all(axis=1) for place in needed], axis=0), self.places[kind]] = np.nan
        inputs = list(input_rows(machine, references, NoiseInputs.draw(len(raw), None, machine)).values())
        records = [self.loop.step(inputs)]
        records += [replay.push(inputs, feed, rate, held, raw) for replay in self.segments.values()]
        runs, now = self.simulated.push(np.stack(records, axis=1), last)
        seen = delay_columns(machine, runs.swapaxes(0, 1), self.indices)[:, now]
        both, now = self.measured.push(np.hstack([raw, judged[ready]]), last)
        raw, judged = np.split(both[now], 2, axis=1)
        replayed = [(judged - run)[:, self.places[kind]] for kind, run in zip(self.segments, seen[1:], strict=True)]
        return np.hstack([raw - seen[0], *replayed])
