"""Requirements on a case, and its logs beside those that the nominal robot writes on the same references.

Both have noise and rounding, so that a check that compares them needs neither units nor names of a machine.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from exodrake.core.errors import InputError, MissingColumn
from exodrake.data.case import Case, CaseLog
from exodrake.data.log import fast_noise, fill_columns
from exodrake.engine.inputs import Reference
from exodrake.model.machine import Machine
from exodrake.model.robot import Robot
from exodrake.simulation.protocols import reference_rows
from exodrake.simulation.simulate import run, write_log

SHORTEST = 50  # frames; at the Exo-Index's 20 ms that is 1 s, longer than the loop's memory
LONGEST = 90_000  # frames of all logs together, half an hour at 20 ms: beyond, a search takes hours and gigabytes
REPEATS = 0.01  # of the motion, and of the rows, by which references of repeats may differ (assumed: rounding, jitter)
NAMED = 3  # columns and files that a sentence names (assumed)
UNITS = (180.0 / np.pi, 100.0, 1000.0)  # degrees in a radian; centi and milli
FACTORS = (-1.0, *(sign * unit**power for unit in UNITS for sign in (1.0, -1.0) for power in (1, -1)))
NEAR = (UNITS[1] / UNITS[0]) ** 0.5  # ratio to a factor; geometrically half-way between the two closest ones
ALIKE = 0.9  # correlation from which a channel has the shape of the nominal robot's (assumed)
CLEAR = 2.0  # ratio of standard deviations with p < 1e-3 from 25 independent samples on (F test); of shares: assumed
EXACT = 1e-9  # of a signal's range, or s between two frame periods: less is rounding of the computer
ABOVE = 1.1  # ratio to the nominal fast noise in every channel of a sensor; healthy robots lie between 0.94 and 1.04


def check_case(case: Case, machine: Machine) -> None:
    """Refuses another frame or other channels than the machine's, too many frames, and false repeats: InputError.

    It names the log, and of a repeat with another reference the column and the row. References that are constant in
    every log, such as initial states, may differ.
    """
    if abs(case.period - machine.frame) > EXACT:
        there = f"{machine.name} has frames of {machine.frame:g} s; `exodrake import` lays rows on frames"
        raise InputError(f"{case.name}: frames of {case.period:g} s, {there}")
    for item, column in product(case.logs, (c for c in machine.columns if c.required)):
        for name in machine.log_names([column]):
            if name not in item.log.signals:
                listed = ", ".join(machine.channels(column.signal))
                raise MissingColumn(f"{item.file}: required column {name!r} is missing ({machine.name} has {listed})")
    frames = sum(len(item.log) for item in case.logs)
    if frames > LONGEST:
        raise InputError(
            f"{case.name}: {frames} frames of logs, a diagnosis takes {LONGEST}; a few logs of a minute say as much"
        )
    logs = {item.file: item.log for item in case.logs}
    for reference, item in product(machine.references, (item for item in case.logs if item.repeats)):
        channels = machine.channels(reference.signal)
        own, other = (log.array(reference.kind, channels) for log in (item.log, logs[str(item.repeats)]))
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
    fewest = SHORTEST + round(machine.settling / machine.frame)  # the first ones do not count
    short = {item.file: len(item.log) for item in case.logs if len(item.log) < fewest}
    if not short:
        return case
    least = f"{fewest} ({fewest * machine.frame:g} s)"
    kept = tuple(item for item in case.logs if item.file not in short and item.repeats not in short)
    if not any(item.role == "fit" for item in kept):
        file, frames = next(iter(short.items()))
        raise InputError(f"{file}: {frames} frames, a diagnosis needs {least}")
    note = f"left out, since a diagnosis needs {least} frames: {', '.join(sorted(short))}"
    return replace(case, logs=kept, notes=(*case.notes, note))


def find_columns(case: Case, machine: Machine) -> tuple[str, ...]:
    """Columns to compare that every log of the case has, in the machine's order. InputError if there is none."""
    wanted = machine.log_names(machine.column(kind) for kind in machine.compared)
    found = tuple(c for c in wanted if all(c in item.log.signals for item in case.logs))
    if not found:
        compared = ", ".join(machine.compared)
        raise InputError(f"{case.name}: no log has a column to compare with {machine.name}: {compared}")
    return found


class Channel:
    """A column of one log and the same of the nominal robot, missing samples left out.

    measured, nominal: (n,) [unit of the column].
    """

    def __init__(self, column: str, file: str, measured: np.ndarray, nominal: np.ndarray) -> None:
        self.column, self.file, self.measured, self.nominal = column, file, measured, nominal
        spread, nominal_spread = np.std(measured), np.std(nominal)
        self.factor = 1.0  # of another unit or sign that the channel seems to carry
        if spread > 0.0 and nominal_spread > 0.0 and abs(correlation := np.corrcoef(measured, nominal)[0, 1]) >= ALIKE:
            ratio = np.sign(correlation) * spread / nominal_spread
            self.factor = next((f for f in FACTORS if 1.0 / NEAR < ratio / f < NEAR), 1.0)
        self.noise = fast_noise(measured / self.factor)  # in the unit that the samples seem to have
        self.nominal_noise = fast_noise(nominal)
        # of a rounded channel two steps, below which rounding may be taken for noise
        self.least_noise = max(self.nominal_noise, CLEAR * find_step(nominal))
        changes, steps = bool(np.median(np.abs(np.diff(measured))) > 0.0), np.abs(np.diff(nominal))
        # rounding leaves the noise: it is more than a step in the nominal log, and most measured samples change
        smallest = float(steps[steps > EXACT * np.ptp(nominal)].min(initial=np.inf))
        self.carries_noise = changes and self.nominal_noise > smallest
        # rounding hides neither the nominal noise nor a larger one that is measured
        louder = self.carries_noise or fast_noise(measured) > ABOVE * self.least_noise
        self.audible = changes and louder and self.least_noise > EXACT * np.ptp(measured)


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

    @cached_property
    def kinds(self) -> np.ndarray:
        """Kind of each column (columns,)."""
        return np.array([column.rsplit("_", 1)[0] for column in self.columns])

    def audible(self, column: str) -> list[Channel]:
        """The audible channels of a column."""
        return [c for c in self.channels if c.column == column and c.audible]


def compare(case: Case, robot: Robot) -> Comparison:
    """The nominal robot simulated once on each log's reference, noise and rounding included."""
    machine, columns = robot.machine, find_columns(case, robot.machine)
    pairs, channels = [], []
    for seed, item in enumerate(case.logs):
        reference = fill_columns(reference_rows(machine, item.log))
        simulated = write_log(run(robot, Reference(reference, item.file), seed=seed))
        measured, nominal = (np.column_stack([log[c] for c in columns]) for log in (item.log, simulated))
        known = np.isfinite(measured) & np.isfinite(nominal)
        whole = (fill_columns(np.where(known, x, np.nan)) for x in (measured, nominal))
        pairs.append(LogPair(item, reference, *whole))
        for column, rows, own, theirs in zip(columns, known.T, measured.T, nominal.T, strict=True):
            if rows.sum() >= SHORTEST:
                channels.append(Channel(column, item.file, own[rows], theirs[rows]))
    return Comparison(case, robot, columns, tuple(pairs), tuple(channels))


def list_few(names: Iterable[str], count: int = NAMED) -> str:
    """The first few of some names, each once, and how many more there are."""
    once = list(dict.fromkeys(names))
    return ", ".join(once[:count]) + (f" and {len(once) - count} more" if len(once) > count else "")


def find_step(values: np.ndarray) -> float:
    """Smallest change of a rounded signal (n,), whose samples mostly repeat; 0 for another one and for a constant."""
    steps = np.abs(np.diff(values))
    return float(np.min(steps, initial=np.inf, where=steps > 0.0)) if steps.any() and np.median(steps) == 0.0 else 0.0
