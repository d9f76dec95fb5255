"""The logs of a case as three robots would have run them: nominal, retuned and improved."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from exodrake.core.display import Display, display_of
from exodrake.diagnosis.filters import mismatch
from exodrake.diagnosis.problem import Problem, Trial
from exodrake.diagnosis.result import Diagnosis
from exodrake.report.wording import split_column

NOMINAL, RETUNED, IMPROVED = "nominal", "retuned", "improved"
ROBOTS: tuple[str, ...] = (NOMINAL, RETUNED, IMPROVED)


@dataclass(frozen=True, eq=False)
class SimulatedLog:
    """A log and the same motion simulated.

    Attributes:
        trial: what was measured.
        simulated: robot -> (n, columns) array [SI], noise-free and unquantised.
        noise_std: (columns,) noise standard deviations [SI].
    """

    trial: Trial
    simulated: dict[str, np.ndarray]
    noise_std: np.ndarray

    @cached_property
    def residuals(self) -> dict[str, np.ndarray]:
        """Robot -> normalised residuals (n, columns), NaN where nothing was measured or the robot diverged."""
        found = {name: (self.trial.measured - rows) / self.noise_std for name, rows in self.simulated.items()}
        return {name: np.where(np.isfinite(rows), rows, np.nan) for name, rows in found.items()}


@dataclass(frozen=True, eq=False)
class SimulatedLogs:
    """The logs of a case and the same motion simulated.

    Attributes:
        problem: trials, columns and their noise standard deviations.
        logs: fitted ones, then held-out ones.
    """

    problem: Problem
    logs: tuple[SimulatedLog, ...]

    @property
    def judged(self) -> tuple[SimulatedLog, ...]:
        """Logs that the closure is measured on; none where no column is compared."""
        judged = {trial.name for trial in self.problem.judged}
        return tuple(log for log in self.logs if log.trial.name in judged) if self.problem.columns else ()

    @property
    def period(self) -> float:
        """Length of a frame [s]."""
        return self.problem.robot.machine.frame

    @cached_property
    def parts(self) -> tuple[tuple[str, str], ...]:
        """Kind and channel of each column."""
        return tuple(split_column(column, self.problem.robot.machine) for column in self.problem.columns)

    @property
    def loop_answer(self) -> str:
        """Kind of signal by which the control loop answers an error of the plant; empty if the machine has none."""
        observer = self.problem.robot.machine.observer
        return observer.measured_input if observer else ""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of signals, in the order of the columns; the loop's answer last."""
        kinds = dict.fromkeys(kind for kind, _ in self.parts)
        return tuple(sorted(kinds, key=lambda kind: kind == self.loop_answer))

    def display(self, kind: str) -> Display:
        """Display of a kind of signal."""
        return display_of(kind, self.problem.robot.machine)

    def of_kind(self, kind: str) -> list[int]:
        """Indices of the columns of one kind."""
        return [i for i, (own, _) in enumerate(self.parts) if own == kind]

    def rms(self, log: SimulatedLog, robot: str) -> float:
        """RMS error of a robot on a log [noise_std], in the band of a tremor its strength alone, as for the closure."""
        gaps = mismatch(log.trial.measured, log.simulated[robot], self.problem.notched, self.period) / log.noise_std
        return float(np.sqrt(np.nanmean(gaps**2))) if gaps.size else float("nan")


def simulate_logs(diagnosis: Diagnosis, problem: Problem) -> SimulatedLogs:
    """Simulates the logs of a case with the nominal, the retuned and the improved robot."""
    plain = replace(problem, detected=())  # the robots hold what was detected
    rows = np.array([plain.silent(diagnosis.robots[name]) for name in ROBOTS])
    runs = ((t, dict(zip(ROBOTS, problem.predict(rows, t)))) for t in (*problem.fit, *problem.holdout))
    return SimulatedLogs(problem, tuple(SimulatedLog(t, simulated, problem.noise_std) for t, simulated in runs))
