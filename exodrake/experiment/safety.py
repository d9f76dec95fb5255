"""Safety: on every rival explanation all signals of an experiment stay within ranges that are known to be safe.

The range of a signal spans
    the limits of the robot file, for signals in the unit of the reference
    the values in runs of each explanation on the logs of the case, which the robot has survived
    the values in runs of the nominal robot on the machine's own experiments, which stay within the stated limits
and is widened by a share. Positions have a range of rates, too, from the last two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.display import in_words
from exodrake.core.machine import Machine, signal_count
from exodrake.diagnosis.problem import Problem, Trial
from exodrake.experiment.motion import POSITIONS

MARGIN = 0.05  # of a range, by which it is widened at either end, for overshoot: assumed
FASTER = 1.1  # times the fastest rate known: assumed


@dataclass(frozen=True, eq=False)
class Safety:
    """Ranges of all signals.

    Attributes:
        machine: whose signals they are.
        low, high: (signals,) ends of the ranges [SI]; infinite for what is not limited.
        rate: (signals,) largest rates of positions [SI / s]; infinite for the others.
    """

    machine: Machine
    low: np.ndarray
    high: np.ndarray
    rate: np.ndarray

    def violations(self, names: Sequence[str], records: np.ndarray) -> list[str]:
        """Sentences on signals that leave their range.

        Args:
            names: of the explanations.
            records: (explanations, frames, signals) of their runs [SI].
        """
        found, machine = [], self.machine
        records = np.nan_to_num(records, nan=np.inf)
        for name, run in zip(names, records, strict=True):
            rates = np.abs(np.diff(run, axis=0)).max(axis=0) / machine.frame
            high, low = run.max(axis=0), run.min(axis=0)
            for k, label, unit in labels(machine):
                if high[k] > self.high[k]:
                    course = f"up to {in_words(high[k], unit)}, at most {in_words(self.high[k], unit)}"
                elif low[k] < self.low[k]:
                    course = f"down to {in_words(low[k], unit)}, at least {in_words(self.low[k], unit)}"
                elif rates[k] > self.rate[k]:
                    course = f"at {in_words(rates[k], unit + '/s')}, at most {in_words(self.rate[k], unit + '/s')}"
                else:
                    continue
                found.append(f"{label} would go {course}, if the cause is {name}")
        return found


@dataclass(frozen=True)
class Span:
    """A signal on the channel where it comes nearest to the ends of its range: what it reaches, and the range [SI]."""

    signal: str
    unit: str
    reached: tuple[float, float]
    allowed: tuple[float, float]


def spans(safety: Safety, records: np.ndarray) -> list[Span]:
    """Ranges that the logged signals reach, each on the channel nearest to its limits.

    Args:
        safety: the ranges.
        records: (explanations, frames, signals) of runs [SI].
    """
    shown = dict.fromkeys(c.signal for c in safety.machine.columns)
    low, high, found = records.min(axis=(0, 1)), records.max(axis=(0, 1)), {}
    for k, label, unit in labels(safety.machine):
        name = next((s for s in shown if label == s or label.rsplit("_", 1)[0] == s), None)
        if name is None:
            continue
        width = max(safety.high[k] - safety.low[k], 1e-12)
        room = min(safety.high[k] - high[k], low[k] - safety.low[k]) / width
        span = Span(label, unit, (float(low[k]), float(high[k])), (float(safety.low[k]), float(safety.high[k])))
        if name not in found or room < found[name][0]:
            found[name] = room, span
    return [span for _, span in found.values()]


def labels(machine: Machine) -> list[tuple[int, str, str]]:
    """Position, name with channel, and unit of every signal that parts write."""
    at = machine.offsets
    return [
        (at[s.name].start + k, f"{s.name}_{channel}".rstrip("_"), s.unit)
        for s in machine.signals
        if s.name not in machine.inputs
        for k, channel in enumerate(machine.axes.of(s.axis))
    ]


def safety_of(problem: Problem, robots: np.ndarray, known: Sequence[Reference]) -> Safety:
    """The ranges for a case.

    Args:
        problem: the case.
        robots: (explanations, parameters) flat parameter vectors [SI].
        known: the machine's own experiments.
    """
    machine = problem.robot.machine
    runs = [run for trial in problem.fit for run in problem.records(robots, trial)]
    nominal = problem.silent()[None]
    for reference in known:
        (run,) = problem.records(nominal, Trial(reference.name, "fit", reference.values, np.zeros((0, 0))))
        runs.append(run)
    low, high = np.full(signal_count(machine), -np.inf), np.full(signal_count(machine), np.inf)
    rate = high.copy()
    lowest, highest = problem.robot.reference_limits()
    first, at = machine.signal[machine.references[0].signal], machine.offsets
    stated = {s.name for s in machine.signals if (s.unit, s.axis) == (first.unit, first.axis)}
    for k, _, unit in labels(machine):
        ends = [end for run in runs for end in (run[:, k].min(), run[:, k].max())]
        name = next(s.name for s in machine.signals if at[s.name].start <= k < at[s.name].stop)
        if name in stated:
            channel = k - at[name].start
            ends += [lowest[channel], highest[channel]]
        wider = MARGIN * (max(ends) - min(ends))
        low[k], high[k] = min(ends) - wider, max(ends) + wider
        if unit in POSITIONS:
            rate[k] = FASTER * max(np.abs(np.diff(run[:, k])).max(initial=0.0) for run in runs) / machine.frame
    return Safety(machine, low, high, rate)
