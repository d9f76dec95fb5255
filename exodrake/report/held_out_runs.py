"""The held-out logs as three robots would have run them: nominal, retuned and improved."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from exodrake.core.display import Display, display_of
from exodrake.diagnosis import regime
from exodrake.diagnosis.problem import Problem, Trial
from exodrake.diagnosis.result import Diagnosis
from exodrake.report.wording import split_column

NOMINAL, RETUNED, IMPROVED = "nominal", "retuned", "improved"
ROBOTS = (NOMINAL, RETUNED, IMPROVED)
UNIT = 1.0  # what a change of a parameter that is 0 is compared with [its unit]
BINS = 14  # of a condition


@dataclass(frozen=True, eq=False)
class HeldOutRuns:
    """Held-out logs and the same motion simulated.

    Attributes:
        problem: trials, columns and their noise standard deviations.
        simulated: for each held-out trial, robot -> (n, columns) array [SI], noise-free and unquantised.
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
    def parts(self) -> tuple[tuple[str, str], ...]:
        """Kind and channel of each column."""
        return tuple(split_column(column, self.problem.robot.machine) for column in self.columns)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of signals, in the order of the columns."""
        return tuple(dict.fromkeys(kind for kind, _ in self.parts))

    @property
    def controller_output(self) -> str:
        """Kind of signal by which the control loop answers an error of the plant; empty if the machine has none."""
        observer = self.problem.robot.machine.observer
        return observer.measured_input if observer else ""

    def display(self, kind: str) -> Display:
        """How a kind of signal is shown."""
        return display_of(kind, self.problem.robot.machine)

    def of_kind(self, kind: str) -> list[int]:
        """Indices of the columns of one kind."""
        return [i for i, (own, _) in enumerate(self.parts) if own == kind]

    @cached_property
    def residuals(self) -> tuple[dict[str, np.ndarray], ...]:
        """For each trial, robot -> normalised residuals (n, columns), NaN where nothing was measured."""
        noise_std = self.problem.noise_std
        pairs = zip(self.problem.judged, self.simulated)
        return tuple({name: (t.measured - rows) / noise_std for name, rows in runs.items()} for t, runs in pairs)

    @cached_property
    def shown(self) -> int:
        """Index of the held-out trial with the largest gap: the one that is drawn."""
        return int(np.argmax([np.nanmean(runs[NOMINAL] ** 2) for runs in self.residuals]))

    @property
    def trial(self) -> Trial:
        """The trial that is drawn."""
        return self.problem.judged[self.shown]

    def worst(self) -> int:
        """Index of the column with the largest normalised gap of the retuned robot, the controller's output aside."""
        power = np.mean([np.nanmean(runs[RETUNED] ** 2, axis=0) for runs in self.residuals], axis=0)
        plain = [i for i, (kind, _) in enumerate(self.parts) if kind != self.controller_output]
        return max(plain or range(len(power)), key=lambda i: power[i])


def simulate_held_out(diagnosis: Diagnosis, problem: Problem) -> HeldOutRuns:
    """Simulates the held-out logs with the nominal, the retuned and the improved robot."""
    names = [name for name in ROBOTS if name in diagnosis.robots]
    plain = replace(problem, detected=())  # the robots hold what was detected
    rows = np.array([plain.silent(diagnosis.robots[name]) for name in names])
    runs = (dict(zip(names, problem.predict(rows, trial))) for trial in problem.judged)
    return HeldOutRuns(problem, tuple(runs))


@dataclass(frozen=True, eq=False)
class Condition:
    """Residuals of a signal against a condition.

    Attributes:
        name: of the condition. signal: column whose residuals these are.
        at: (n,) values of the condition [SI].
        before, after: (n,) normalised residuals of the retuned and of the improved robot.
    """

    name: str
    signal: str
    at: np.ndarray
    before: np.ndarray
    after: np.ndarray


def top_condition(diagnosis: Diagnosis, runs: HeldOutRuns) -> Condition | None:
    """The condition that explains most of the worst signal's residual; None where there is no regime."""
    if not diagnosis.where.regime or not runs.columns or not runs.residuals:
        return None
    column = runs.worst()
    channel = regime.channel_of(runs.problem, runs.columns[column])
    table = regime.conditions(runs.problem, runs.trial, channel)
    residuals = runs.residuals[runs.shown]
    before, after = residuals[RETUNED][:, column], residuals[IMPROVED][:, column]
    known = np.isfinite(before) & np.isfinite(after)
    explained = {name: regime.explained(before[known], at[known]) for name, at in table.items()}
    name = max(explained, key=lambda n: explained[n])
    return Condition(name, runs.columns[column], table[name][known], before[known], after[known])


def binned(at: np.ndarray, values: np.ndarray, bins: int = BINS) -> tuple[np.ndarray, np.ndarray]:
    """Mean condition and mean value in bins of equal count (or of equal condition, where it has few values)."""
    levels = np.unique(at)
    if len(levels) <= bins:
        return levels, np.array([values[at == level].mean() for level in levels])
    groups = np.array_split(np.argsort(at, kind="stable"), bins)
    return np.array([at[g].mean() for g in groups]), np.array([values[g].mean() for g in groups])


def spectra(runs: HeldOutRuns, robot: str, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Frequency [Hz] and mean power density [1/Hz] of the normalised residuals of one kind, over held-out trials."""
    found = []
    for residuals in runs.residuals:
        for i in runs.of_kind(kind):
            found.append(regime.spectrum(np.nan_to_num(residuals[robot][:, i]), runs.period))
    shortest = min(len(frequency) for frequency, _ in found)
    same = [power for frequency, power in found if len(frequency) == shortest]
    frequency = next(frequency for frequency, _ in found if len(frequency) == shortest)
    return frequency, np.mean(same, axis=0)


def changed_parameters(diagnosis: Diagnosis) -> list[tuple[str, str, float, float]]:
    """Nominal parameters that the last robot changes: name, unit, before, after [SI]; the largest change first."""
    nominal, improved = diagnosis.robots[NOMINAL], diagnosis.robots[IMPROVED]
    rows = zip(nominal.machine.parameters, nominal.values, improved.values)
    found = [(e.name, e.unit, float(a), float(b)) for e, a, b in rows if e.null is None and a != b]
    return sorted(found, key=lambda row: -abs(row[3] - row[2]) / (abs(row[2]) or UNIT))
