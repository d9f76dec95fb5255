"""The likelihood of the diagnosis with the memory of what is left, its blocks, and the noise of runs not whitened."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from exodrake.diagnosis import likelihood as diagnosis
from exodrake.diagnosis.likelihood import CORRELATION, with_prediction
from exodrake.diagnosis.problem import Problem, by_trial

__all__ = ["Likelihood", "likelihood_of", "output_error", "with_prediction"]


@dataclass(frozen=True, eq=False)
class Likelihood(diagnosis.Likelihood):
    """Views of a case side by side.

    Attributes:
        memory: frames that count as one.
    """

    memory: float = 1.0

    @property
    def blocks(self) -> list[tuple[int, int, slice]]:
        """View, log and samples of each log in each view."""
        found, at = [], 0
        for v, view in enumerate(self.views):
            for k, trial in enumerate(view.problem.fit):
                found.append((v, k, slice(at, at := at + trial.measured.size)))
        return found

    def for_stage(self, stage: str) -> Self:
        """The likelihood whose simulations count under another stage."""
        return replace(self, stage=stage)

    def scaled_to(self, residual: np.ndarray) -> Self:
        """The likelihood with each view in units of what a residual (samples,) leaves, noise at least."""
        scales = np.sqrt(np.maximum(self.chi2(residual), 1.0) * self.memory)
        views = tuple(replace(view, scale=float(s)) for view, s in zip(self.views, scales, strict=True))
        return replace(self, views=views)

    def with_memory_of(self, residual: np.ndarray) -> Self:
        """The likelihood in which as many samples count as one as a residual (samples,) is correlated over.

        Squares of its autocorrelation are summed, since evidence rests on sums of squares (Bayley & Hammersley 1946),
        up to the longest time over which a model's error repeats.
        """
        longest = max(round(CORRELATION / self.robot.machine.frame), 1)
        sums = np.zeros(longest + 1)
        for view, part in zip(self.views, self.split(residual), strict=True):
            for log in by_trial(part, view.problem.fit):
                for lag in range(min(longest, len(log) - 1) + 1):
                    sums[lag] += float(np.sum(log[lag:] * log[: len(log) - lag]))
        rho = sums / max(sums[0], 1e-300)
        return replace(self, memory=float(np.clip(1.0 + 2.0 * np.sum(rho[1:] ** 2), 1.0, longest)))


def of(found: diagnosis.Likelihood) -> Likelihood:
    """A likelihood of the diagnosis with the longest memory."""
    longest = float(max(round(CORRELATION / found.robot.machine.frame), 1))
    return Likelihood(found.views, found.simulated, found.stage, found.counted, longest)


def output_error(problem: Problem, stage: str = "") -> Likelihood:
    """The likelihood of a case in closed loop alone, in units of the sensors' noise, which counts as white."""
    return of(diagnosis.output_error(problem, stage))


def likelihood_of(problem: Problem, values: np.ndarray, simulated: defaultdict[str, float]) -> Likelihood:
    """The likelihood of a case with the noise of the robot `values` (parameters,)."""
    return of(diagnosis.likelihood_of(problem, values, simulated))
