"""What the page shows beyond the numbers of a diagnosis: the held-out logs as three robots would have run them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from exodrake.diagnosis import regime
from exodrake.diagnosis.problem import Problem, Trial
from exodrake.diagnosis.result import Diagnosis

NOMINAL, RETUNED, IMPROVED = "nominal", "retuned", "improved"
ROBOTS = (NOMINAL, RETUNED, IMPROVED)
WHOLE = 1.0  # what a change of a number that is 0 is compared with [its unit]
BINS = 14  # of a condition


@dataclass(frozen=True, eq=False)
class Evidence:
    """Held-out logs and what the robots of a diagnosis make of them.

    Attributes:
        simulated: for each held-out trial, robot -> (n, columns) [SI], noise-free and unquantised.
    """

    problem: Problem
    simulated: tuple[dict[str, np.ndarray], ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns that are compared."""
        return self.problem.columns

    @property
    def period(self) -> float:
        """Length of a frame [s]."""
        return self.problem.robot.machine.frame

    @cached_property
    def residuals(self) -> tuple[dict[str, np.ndarray], ...]:
        """For each trial, robot -> (measured - simulated) / floor (n, columns), NaN where nothing was measured."""
        floor = self.problem.noise_std
        pairs = zip(self.problem.holdout, self.simulated)
        return tuple({name: (t.measured - rows) / floor for name, rows in runs.items()} for t, runs in pairs)

    @cached_property
    def shown(self) -> int:
        """EffectParameter of the held-out trial with the largest gap: the one that is drawn."""
        return int(np.argmax([np.nanmean(runs[NOMINAL] ** 2) for runs in self.residuals]))

    @property
    def trial(self) -> Trial:
        """The trial that is drawn."""
        return self.problem.holdout[self.shown]

    def of_kind(self, kind: str) -> list[int]:
        """Numbers of the columns of one kind."""
        return [i for i, column in enumerate(self.columns) if column.rsplit("_", 1)[0] == kind]

    def worst(self) -> int:
        """EffectParameter of the column with the largest gap of the retuned robot [floors], speed command left
        aside.
        """
        power = np.mean([np.nanmean(runs[RETUNED] ** 2, axis=0) for runs in self.residuals], axis=0)
        plain = [i for i, column in enumerate(self.columns) if not column.startswith("speed_cmd")]
        return max(plain or range(len(power)), key=lambda i: power[i])


def gather(diagnosis: Diagnosis, problem: Problem) -> Evidence:
    """Simulates the held-out logs with the nominal, the retuned and the improved robot, by the compiled simulator."""
    names = [name for name in ROBOTS if name in diagnosis.robots]
    rows = np.array([problem.silent(diagnosis.robots[name]) for name in names])
    runs = (dict(zip(names, problem.predict(rows, trial))) for trial in problem.holdout)
    return Evidence(problem, tuple(runs))


@dataclass(frozen=True, eq=False)
class Condition:
    """Residual of a signal against a condition: `at` (n,), residuals (n,) of two robots [floors], name and signal."""

    name: str
    signal: str
    at: np.ndarray
    before: np.ndarray
    after: np.ndarray


def top_condition(diagnosis: Diagnosis, evidence: Evidence) -> Condition | None:
    """The condition that explains most of the worst signal's residual; None where there is no regime."""
    if not diagnosis.where.regime:
        return None
    column = evidence.worst()
    channel = regime.channel_of(evidence.problem, evidence.columns[column])
    table = regime.conditions(evidence.problem, evidence.trial, channel)
    runs = evidence.residuals[evidence.shown]
    before, after = runs[RETUNED][:, column], runs[IMPROVED][:, column]
    known = np.isfinite(before) & np.isfinite(after)
    found = {name: regime.explained(before[known], at[known]) for name, at in table.items()}
    name = max(found, key=lambda n: found[n])
    return Condition(name, evidence.columns[column], table[name][known], before[known], after[known])


def binned(at: np.ndarray, values: np.ndarray, bins: int = BINS) -> tuple[np.ndarray, np.ndarray]:
    """Mean condition and mean value in bins of equal count (or of equal condition, where it has few values)."""
    levels = np.unique(at)
    if len(levels) <= bins:
        return levels, np.array([values[at == level].mean() for level in levels])
    groups = np.array_split(np.argsort(at, kind="stable"), bins)
    return np.array([at[g].mean() for g in groups]), np.array([values[g].mean() for g in groups])


def spectra(evidence: Evidence, robot: str, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Frequency [Hz] and mean power density of the residuals of one kind [floor^2 / Hz], over all held-out trials."""
    found = []
    for runs in evidence.residuals:
        for i in evidence.of_kind(kind):
            found.append(regime.spectrum(np.nan_to_num(runs[robot][:, i]), evidence.period))
    shortest = min(len(frequency) for frequency, _ in found)
    same = [power for frequency, power in found if len(frequency) == shortest]
    frequency = next(frequency for frequency, _ in found if len(frequency) == shortest)
    return frequency, np.mean(same, axis=0)


def changed_parameters(diagnosis: Diagnosis) -> list[tuple[str, str, float, float]]:
    """Nominal numbers that the last robot changes: name, unit, before, after [SI]; the largest change first."""
    nominal, improved = diagnosis.robots[NOMINAL], diagnosis.robots[IMPROVED]
    rows = zip(nominal.machine.parameters, nominal.values, improved.values)
    found = [(e.name, e.unit, float(a), float(b)) for e, a, b in rows if e.null is None and a != b]
    return sorted(found, key=lambda row: -abs(row[3] - row[2]) / (abs(row[2]) or WHOLE))
