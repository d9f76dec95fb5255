"""Quality of the recordings: clocks, gaps, saturation, noise and excitation of each log and channel."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from exodrake.core.robot import Robot
from exodrake.data.case import FILE, Case, find_logs, read_case_file
from exodrake.data.formats import read_table
from exodrake.data.log import Log
from exodrake.diagnosis.checks.channels import longest_run
from exodrake.diagnosis.checks.compare import Comparison
from exodrake.diagnosis.checks.noise import LEAST_MOTION, fast_noise

JITTER = 0.1  # of a frame by which rows may be off without a word: assumed
DRIFT = 1e-4  # relative error of a clock: crystals keep 100 ppm
HELD = 3  # samples in a row at the end of a range that count as saturated
SATURATED, BEYOND = 0.05, 3.0  # share of samples, and times the nominal robot's: assumed
POWER = 0.95  # of the motion's variance, below the frequency that is stated
SMALL = 0.1  # of the span between the limits: less motion shows little


@dataclass(frozen=True)
class Clock:
    """The clock of one log as recorded.

    Attributes:
        file: of the log.
        rows: as recorded.
        duration: [s].
        step: median step [s].
        jitter: standard deviation of the steps over the step, gaps left out [-].
        drift: relative difference of the mean step, gaps left out, from the machine's frame [-].
        missing: frames without a row.
        repeated: rows with the time of the row before.
    """

    file: str
    rows: int
    duration: float
    step: float
    jitter: float
    drift: float
    missing: int
    repeated: int

    def problems(self) -> list[str]:
        """Problems of the clock, a sentence each."""
        found = []
        if self.jitter > JITTER:
            found.append(f"{self.file}: steps of the clock scatter by {self.jitter:.0%} of a frame")
        if abs(self.drift) > DRIFT + 3.0 * self.jitter / self.rows:  # both ends of the log are as uncertain
            word = "slowly" if self.drift > 0.0 else "fast"
            found.append(f"{self.file}: its rows come {abs(1e6 * self.drift):.0f} ppm too {word}")
        if self.missing:
            found.append(f"{self.file}: {self.missing} of {self.rows + self.missing} frames are missing")
        return found


@dataclass(frozen=True)
class Channel:
    """A compared column over all logs.

    Attributes:
        column: its name.
        missing: share of samples that are missing in rows that are there [-].
        gap: longest run of missing samples [frames].
        saturated: share of samples that stay at an end of the range [-].
        nominal_saturated: the same of the nominal robot on the same references [-].
        motion: standard deviation [SI].
        noise: fast noise, standard deviation [SI].
    """

    column: str
    missing: float
    gap: int
    saturated: float
    nominal_saturated: float
    motion: float
    noise: float

    def problems(self) -> list[str]:
        """Problems of the channel, a sentence each."""
        found = []
        if self.saturated > max(SATURATED, BEYOND * self.nominal_saturated):
            share = f"{self.saturated:.0%} of the samples"
            found.append(f"{self.column} stays at an end of its range in {share}: saturated?")
        if 0.0 < self.motion < LEAST_MOTION * self.noise:
            found.append(f"{self.column} moves by only {self.motion / self.noise:.1f} times its noise")
        return found


@dataclass(frozen=True)
class Excitation:
    """Excitation by a reference, over the logs to fit.

    Attributes:
        column: of the reference.
        span: largest minus smallest value [SI].
        share: of the span between the robot file's limits [-]; NaN without limits.
        band: frequency below which most of its variance lies [Hz].
        reversals: changes of direction.
        rest: share of frames in which it does not move [-].
    """

    column: str
    span: float
    share: float
    band: float
    reversals: int
    rest: float

    def problems(self) -> list[str]:
        """Problems of the excitation, a sentence each."""
        if self.span == 0.0:
            return [f"{self.column} never moves, so its channel shows no friction, play, lag or gain"]
        small = f"{self.column} uses {self.share:.0%} of the span between its limits"
        found = [small] if self.share < SMALL else []
        if self.reversals < 4:
            found.append(f"{self.column} turns {self.reversals} times: play and friction need reversals")
        return found


def clock_of(log: Log, file: str, frame: float) -> Clock:
    """The clock of a log as recorded, against frames of `frame` [s]."""
    steps = np.diff(log.time)
    moving = steps[steps > 0.0]
    if not len(moving):
        return Clock(file, len(log), 0.0, float("nan"), 0.0, 0.0, 0, int((steps == 0.0).sum()))
    count = np.maximum(np.rint(moving / frame), 1.0)
    single = moving[count == 1.0]
    jitter = float(np.std(single)) / frame if len(single) else 0.0
    mean = float(moving.sum() / count.sum())
    return Clock(
        file, len(log), float(log.time[-1] - log.time[0]), float(np.median(moving)), jitter, mean / frame - 1.0,
        int(count.sum()) - len(moving), int((steps == 0.0).sum()),
    )  # fmt: skip


def clocks(path: Path, frame: float) -> tuple[Clock, ...]:
    """Clocks of all logs of a case folder, or of one log, before they are mended."""
    place = path.parent if path.name == FILE else path
    if not place.is_dir():
        return (clock_of(read_table(path), path.name, frame),)
    entries = read_case_file(place / FILE)["logs"] if (place / FILE).is_file() else find_logs(place)[0]
    return tuple(clock_of(read_table(place / entry["file"]), entry["file"], frame) for entry in entries)


def channels(comparison: Comparison) -> tuple[Channel, ...]:
    """Quality of each compared column, over all logs."""
    found = []
    for i, column in enumerate(comparison.columns):
        logs = [pair.item.log for pair in comparison.pairs]
        missing = [np.isnan(log[column]) & ~empty_rows(log) for log in logs]
        held = [(at_ends(pair.measured[:, i]), at_ends(pair.nominal[:, i])) for pair in comparison.pairs]
        values = np.concatenate([pair.measured[:, i] for pair in comparison.pairs])
        noise = [fast_noise(pair.measured[:, i]) for pair in comparison.pairs if len(pair.measured) > 2 * HELD]
        lost, longest = float(np.mean(np.concatenate(missing))), max(longest_run(m, of=True)[1] for m in missing)
        measured, nominal = (float(np.mean(np.concatenate(one))) for one in zip(*held, strict=True))
        fast = float(np.median(noise)) if noise else 0.0
        found.append(Channel(column, lost, longest, measured, nominal, float(np.std(values)), fast))
    return tuple(found)


def empty_rows(log: Log) -> np.ndarray:
    """Rows (n,) without any sample: frames that are missing as a whole [-]."""
    return np.isnan(np.column_stack(list(log.signals.values()))).all(axis=1)


def at_ends(values: np.ndarray) -> np.ndarray:
    """Samples (n,) that stay at the smallest or largest value for `HELD` rows or more, those of a motion only."""
    held = np.zeros(len(values), dtype=bool)
    if np.ptp(values) == 0.0:
        return held
    for end in (values.min(), values.max()):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], values == end, [0]])))
        for start, stop in edges.reshape(-1, 2):
            held[start:stop] = stop - start >= HELD
    return held


def excitations(case: Case, robot: Robot) -> tuple[Excitation, ...]:
    """Excitation of each channel by the machine's first reference, over the logs to fit."""
    machine = robot.machine
    column = machine.references[0]
    low, high = robot.reference_limits()
    limited = bool(machine.reference_limits and robot.limits)
    found = []
    for k, channel in enumerate(machine.channels(column.signal)):
        name = f"{column.kind}_{channel}".rstrip("_")
        logs = [item.log[name][np.isfinite(item.log[name])] for item in case.fit_logs]
        values = np.concatenate(logs)
        moves = [np.sign(np.diff(one)) for one in logs]
        turns = sum(int((np.diff(one[one != 0.0]) != 0.0).sum()) for one in moves)
        span = float(np.ptp(values))
        share = span / float(high[k] - low[k]) if limited else float("nan")
        band = max(band_of(one, machine.frame) for one in logs)
        rest = float(np.mean(np.concatenate(moves) == 0.0))
        found.append(Excitation(name, span, share, band, turns, rest))
    return tuple(found)


def band_of(values: np.ndarray, frame: float) -> float:
    """Frequency [Hz] below which most of the variance of a signal (n,) lies; 0 for one that rests."""
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    if not power.sum() > 0.0:
        return 0.0
    return float(np.fft.rfftfreq(len(values), frame)[int(np.searchsorted(np.cumsum(power) / power.sum(), POWER))])
