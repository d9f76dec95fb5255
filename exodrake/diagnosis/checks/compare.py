"""Requirements on a case, and its logs beside those that the nominal robot writes on the same references.

A check compares a statistic of a measured channel with the same statistic of the simulated one, noise and rounding
included, so that it needs neither units nor the names of a machine.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from math import comb

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.core.robot import Robot
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.filters import filled_columns
from exodrake.diagnosis.noise import robust_std
from exodrake.simulation.references import reference_rows
from exodrake.simulation.simulate import run, write_log

SHORTEST = 100  # frames; at the Exo-Index's 20 ms that is 2 s, longer than the loop's memory
LONGEST = 90_000  # frames of all logs together, half an hour at 20 ms: beyond, a search takes hours and gigabytes
SAME = 1e-9  # s, two frame periods closer than this are one
REPEATS = 0.01  # of the motion, and of the rows, by which references of repeats may differ (assumed: rounding, jitter)
NAMED = 3  # columns and files that a sentence names (assumed)
UNITS = (180.0 / np.pi, 100.0, 1000.0)  # degrees in a radian; centi and milli
FACTORS = (-1.0, *(sign * unit**power for unit in UNITS for sign in (1.0, -1.0) for power in (1, -1)))
NEAR = 1.3  # ratio to a factor; geometrically half-way between the two closest ones
ALIKE = 0.9  # correlation from which a channel has the shape of the nominal robot's (assumed)
CLEAR = 2.0  # ratio of standard deviations with p < 1e-3 from 25 independent samples on (F test); of shares: assumed
EXACT = 1e-9  # of a signal's range: smaller steps are rounding of the computer
ABOVE = 1.1  # ratio to the nominal fast noise in every channel of a sensor; healthy robots lie between 0.94 and 1.04
ORDER = 4  # differences that leave noise of what moves slowly (assumed)


def check_case(case: Case, machine: Machine) -> None:
    """Refuses another frame or other channels than the machine's, too many frames, and false repeats.

    Raises:
        InputError: naming the log, and of a repeat with another reference the column and the row. References that are
            constant in every log, such as initial states, may differ.
    """
    if abs(case.period - machine.frame) > SAME:
        raise InputError(f"{case.name}: frames of {case.period:g} s, {machine.name} has frames of {machine.frame:g} s")
    for item in case.logs:
        for column in (c for c in machine.columns if c.required):
            channels = machine.channels(column.signal)
            for name in (f"{column.kind}_{channel}" for channel in channels):
                if name not in item.log.signals:
                    listed = ", ".join(channels)
                    raise InputError(f"{item.file}: required column {name!r} is missing ({machine.name} has {listed})")
    frames = sum(len(item.log) for item in case.logs)
    if frames > LONGEST:
        raise InputError(
            f"{case.name}: {frames} frames of logs, a diagnosis takes {LONGEST}; a few logs of a minute say as much"
        )
    logs = {item.file: item.log for item in case.logs}
    repeats = [(item, logs[item.repeats]) for item in case.logs if item.repeats]
    for reference in machine.references:
        channels = machine.channels(reference.signal)
        for item, repeated in repeats:
            own, other = (log.array(reference.kind, channels) for log in (item.log, repeated))
            rows = min(len(own), len(other))
            motion = max(np.nanstd(own, axis=0).max(), np.nanstd(other, axis=0).max())
            apart = np.abs(own[:rows] - other[:rows]) > REPEATS * motion
            if motion > 0.0 and apart.any(axis=1).mean() > REPEATS:
                row, channel = np.argwhere(apart)[0]
                raise InputError(
                    f"{item.file}: column '{reference.kind}_{channels[channel]}', row {row + 2}: another reference "
                    f"than in {item.repeats}, which it is said to repeat"
                )


def without_short_logs(case: Case, machine: Machine) -> Case:
    """The case without logs that are too short to tell anything, with a note; InputError if no fitted log is left."""
    short = [item for item in case.logs if len(item.log) < SHORTEST]
    if not short:
        return case
    least = f"{SHORTEST} ({SHORTEST * machine.frame:g} s)"
    gone = {item.file for item in short}
    kept = tuple(item for item in case.logs if item.file not in gone and item.repeats not in gone)
    if not any(item.role == "fit" for item in kept):
        raise InputError(f"{short[0].file}: {len(short[0].log)} frames, a diagnosis needs {least}")
    listed = ", ".join(sorted(gone))
    return replace(case, logs=kept, notes=(*case.notes, f"left out, since a diagnosis needs {least} frames: {listed}"))


@dataclass(frozen=True, eq=False)
class Channel:
    """A column of one log and the same of the nominal robot, missing samples left out."""

    column: str
    file: str
    measured: np.ndarray  # (n,) [unit of the column]
    nominal: np.ndarray  # (n,) [unit of the column]

    @cached_property
    def factor(self) -> float:
        """The factor of another unit or sign that the channel seems to carry; 1 for none."""
        spread, nominal = np.std(self.measured), np.std(self.nominal)
        if spread == 0.0 or nominal == 0.0:
            return 1.0
        correlation = np.corrcoef(self.measured, self.nominal)[0, 1]
        ratio = np.sign(correlation) * spread / nominal if abs(correlation) >= ALIKE else 1.0
        return next((f for f in FACTORS if 1.0 / NEAR < ratio / f < NEAR), 1.0)

    @cached_property
    def noise(self) -> float:
        """Fast noise of the measured samples in the unit that they seem to have."""
        return fast_noise(self.measured / self.factor)

    @cached_property
    def nominal_noise(self) -> float:
        """Fast noise of the nominal samples."""
        return fast_noise(self.nominal)

    @cached_property
    def least_noise(self) -> float:
        """Nominal fast noise; of a rounded channel two steps, below which rounding may be taken for noise."""
        return max(self.nominal_noise, CLEAR * rounding_step(self.nominal))

    @cached_property
    def carries_noise(self) -> bool:
        """Whether rounding leaves the noise: more than a step in the nominal log, and most measured samples change."""
        steps = np.abs(np.diff(self.nominal))
        smallest = steps[steps > EXACT * np.ptp(self.nominal)].min(initial=np.inf)
        return bool(self.nominal_noise > smallest and np.median(np.abs(np.diff(self.measured))) > 0.0)

    @cached_property
    def audible(self) -> bool:
        """Whether rounding hides neither the nominal noise nor a larger one that is measured."""
        changes = np.median(np.abs(np.diff(self.measured))) > 0.0
        if not changes or not self.least_noise > EXACT * np.ptp(self.measured):
            return False
        return self.carries_noise or fast_noise(self.measured) > ABOVE * self.least_noise


@dataclass(frozen=True, eq=False)
class LogPair:
    """A log and the nominal robot's on the same reference, missing samples replaced by the last one known [SI]."""

    item: CaseLog
    reference: np.ndarray  # (n, references)
    measured: np.ndarray  # (n, columns)
    nominal: np.ndarray  # (n, columns)


@dataclass(frozen=True, eq=False)
class Comparison:
    """All logs of a case beside the nominal robot's."""

    case: Case
    robot: Robot
    columns: tuple[str, ...]  # that a diagnosis compares and every log has, in the machine's order
    pairs: tuple[LogPair, ...]
    channels: tuple[Channel, ...]  # columns of each log with at least `SHORTEST` samples

    @property
    def machine(self) -> Machine:
        """The robot's machine."""
        return self.robot.machine

    @cached_property
    def kinds(self) -> np.ndarray:
        """Kind of each column (columns,)."""
        return np.array([column.rsplit("_", 1)[0] for column in self.columns])

    def audible(self, *columns: str) -> list[Channel]:
        """The audible channels of some columns."""
        return [c for column in columns for c in self.channels if c.column == column and c.audible]


def compare(case: Case, robot: Robot) -> Comparison:
    """The nominal robot simulated once on each log's reference, noise and rounding included."""
    machine = robot.machine
    wanted = machine.log_names(machine.column(kind) for kind in machine.compared)
    columns = tuple(c for c in wanted if all(c in item.log.signals for item in case.logs))
    pairs, channels = [], []
    for seed, item in enumerate(case.logs):
        reference = filled_columns(reference_rows(machine, item.log))
        simulated = write_log(run(robot, Reference(reference, item.file), seed=seed))
        measured, nominal = (np.column_stack([log[c] for c in columns]) for log in (item.log, simulated))
        known = np.isfinite(measured) & np.isfinite(nominal)
        whole = (filled_columns(np.where(known, x, np.nan)) for x in (measured, nominal))
        pairs.append(LogPair(item, reference, *whole))
        for column, rows, own, theirs in zip(columns, known.T, measured.T, nominal.T, strict=True):
            if rows.sum() >= SHORTEST:
                channels.append(Channel(column, item.file, own[rows], theirs[rows]))
    return Comparison(case, robot, columns, tuple(pairs), tuple(channels))


def list_few(names: Iterable[str], count: int = NAMED) -> str:
    """The first few of some names, each once, and how many more there are."""
    once = list(dict.fromkeys(names))
    return ", ".join(once[:count]) + (f" and {len(once) - count} more" if len(once) > count else "")


def list_places(channels: Iterable[Channel]) -> str:
    """Columns and files of some channels, for a sentence."""
    listed = list(channels)
    return f"{list_few(c.column for c in listed)} of {list_few(c.file for c in listed)}"


def white_share(values: np.ndarray) -> float:
    """Share of a signal's (n,) variance that is white noise; von Neumann's ratio over 2, 0 for a constant."""
    variance = float(np.var(values))
    return float(np.mean(np.diff(values) ** 2)) / (2.0 * variance) if variance > 0.0 else 0.0


def fast_noise(values: np.ndarray, order: int = ORDER) -> float:
    """Standard deviation of white noise in a signal (n,) that moves slowly, by differences; 0 if rounding.

    Differences of order k raise white noise by the sum of squared binomial coefficients, (2k over k).
    """
    found = robust_std(np.diff(values, order)) / np.sqrt(comb(2 * order, order))
    return 0.0 if found <= np.finfo(float).eps * np.nanmax(np.abs(values), initial=0.0) else found


def rounding_step(values: np.ndarray) -> float:
    """Smallest change of a rounded signal (n,), whose samples mostly repeat; 0 for another one and for a constant."""
    steps = np.abs(np.diff(values))
    return float(np.min(steps, initial=np.inf, where=steps > 0.0)) if steps.any() and np.median(steps) == 0.0 else 0.0


def find_runs(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Starts (runs,) and lengths (runs,) of the runs of equal values (n,)."""
    starts = np.concatenate([[0], np.flatnonzero(values[1:] != values[:-1]) + 1])
    return starts, np.diff(starts, append=len(values))


def longest_run(values: np.ndarray) -> tuple[int, int]:
    """Start and length of the longest run of equal values (n,); of a mask, of the longest run that is set."""
    starts, lengths = find_runs(values)
    lengths = lengths * values[starts] if values.dtype == bool else lengths
    k = int(lengths.argmax())
    return int(starts[k]), int(lengths[k])
