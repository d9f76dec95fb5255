"""A case beside the logs that the nominal robot writes on the same references.

A check compares a statistic of a measured channel with the same statistic of the simulated one, noise and rounding
included, so that it needs neither units nor the names of a machine.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.machine import Machine
from exodrake.core.robot import Robot
from exodrake.data.case import Case, CaseLog
from exodrake.data.log import Log
from exodrake.diagnosis.filters import filled_columns
from exodrake.diagnosis.noise import reference_rows
from exodrake.simulation.simulate import log_of, run

LONG = 25  # frames: what lasts shorter is neither a gap nor frozen (assumed: longer than packets are lost in a row)
FEWEST = 100  # samples of a channel below which it is not judged; the shortest log that is not refused
NAMED = 3  # columns and files that a sentence names (assumed)


@dataclass(frozen=True, eq=False)
class Channel:
    """A column of one log, missing samples left out.

    Attributes:
        column: its name.
        file: its log.
        time: (n,) array [s].
        measured: (n,) array [unit of the column].
        nominal: (n,) array, the nominal robot's.
    """

    column: str
    file: str
    time: np.ndarray
    measured: np.ndarray
    nominal: np.ndarray


@dataclass(frozen=True, eq=False)
class LogPair:
    """A log and the nominal robot's on the same reference, missing samples replaced by the last one known.

    Attributes:
        item: the log.
        reference: (n, references) array [SI].
        measured: (n, columns) array [SI].
        nominal: (n, columns) array [SI].
    """

    item: CaseLog
    reference: np.ndarray
    measured: np.ndarray
    nominal: np.ndarray


@dataclass(frozen=True, eq=False)
class Comparison:
    """All logs of a case beside the nominal robot's; `columns` are the compared ones that every log has."""

    case: Case
    robot: Robot
    columns: tuple[str, ...]
    pairs: tuple[LogPair, ...]
    channels: tuple[Channel, ...]

    @property
    def machine(self) -> Machine:
        """The robot's machine."""
        return self.robot.machine

    @property
    def kinds(self) -> dict[str, list[int]]:
        """Indices of the columns of each kind."""
        found: dict[str, list[int]] = {}
        for i, column in enumerate(self.columns):
            found.setdefault(column.rsplit("_", 1)[0], []).append(i)
        return found

    def of(self, column: str) -> list[Channel]:
        """The channels of one column."""
        return [channel for channel in self.channels if channel.column == column]


def compare(case: Case, robot: Robot) -> Comparison:
    """Simulates the nominal robot once on each log's reference, noise and rounding included."""
    machine = robot.machine
    columns = compared_columns(machine, [item.log for item in case.logs])
    pairs, channels = [], []
    for seed, item in enumerate(case.logs):
        reference = filled_columns(reference_rows(machine, item.log))
        simulated = log_of(run(robot, Reference(reference, item.file), seed=seed))
        measured, nominal = (np.column_stack([log[c] for c in columns]) for log in (item.log, simulated))
        known = np.isfinite(measured) & np.isfinite(nominal)
        pairs.append(
            LogPair(item, reference, *(filled_columns(np.where(known, x, np.nan)) for x in (measured, nominal)))
        )
        for i, column in enumerate(columns):
            if (rows := known[:, i]).sum() >= FEWEST:
                values = (x[rows] for x in (item.log.time, measured[:, i], nominal[:, i]))
                channels.append(Channel(column, item.file, *values))
    return Comparison(case, robot, columns, tuple(pairs), tuple(channels))


def compared_columns(machine: Machine, logs: list[Log]) -> tuple[str, ...]:
    """Columns of the kinds that a diagnosis compares that every log has, in the machine's order."""
    wanted = machine.log_names(machine.column(kind) for kind in machine.compared)
    return tuple(c for c in wanted if all(c in log.signals for log in logs))


def few(names: Iterable[str]) -> str:
    """The first few of some names, each once."""
    once = list(dict.fromkeys(names))
    return ", ".join(once[:NAMED]) + (f" and {len(once) - NAMED} more" if len(once) > NAMED else "")


def places(channels: Iterable[Channel]) -> str:
    """Columns and files of some channels, for a sentence."""
    listed = list(channels)
    return f"{few(c.column for c in listed)} of {few(c.file for c in listed)}"


def white_share(values: np.ndarray) -> float:
    """Share of a signal's (n,) variance that is white noise; von Neumann's ratio over 2, 0 for a constant."""
    variance = float(np.var(values))
    return float(np.mean(np.diff(values) ** 2)) / (2.0 * variance) if variance > 0.0 else 0.0
