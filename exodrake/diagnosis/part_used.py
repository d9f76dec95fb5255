"""Part of the fitted logs that a diagnosis uses: the beginning of each, or all of it where that may mislead."""

from __future__ import annotations

import numpy as np

from exodrake.diagnosis.isolation import Tested
from exodrake.diagnosis.problem import Problem

SHARE = 0.35  # of each fitted log
# times the reduced chi-square of the part used: assumed; that of 40 healthy development robots: 0.91 to 1.02
MORE = 1.2
MOST = 135_000  # samples that a diagnosis fits: about 4 min of the Exo-Index, 75 s of one core and 2.5 GB
DATED = 500_000  # samples in which changes are sought: a quarter of an hour, 45 s and 4 GB


def affordable(problem: Problem, most: float | None = None) -> float:
    """Part of the fitted logs that can be used in reasonable time and memory; `most`: samples, `MOST` if None."""
    return min(1.0, (most or MOST) / sum(trial.measured.size for trial in problem.fit))


def overlooks(problem: Problem, kept: Tested) -> bool:
    """Whether a robot without an effect leaves more in the whole logs than in the part that was used."""
    if kept.explanation.effects:
        return False
    left = problem.residual(kept.explanation.robot[None], problem.fit)[0]
    return float(np.mean(left**2)) > MORE * max(float(kept.chi2[0]), 1.0)


def notes_on_length(problem: Problem, best: Tested) -> tuple[str, ...]:
    """Notes on logs that are too long to be used as far as others are, a sentence each."""
    part = affordable(problem)
    if part >= SHARE:
        return ()
    found = f"the logs are long: the first {part:.0%} of each was fitted"
    more = "; the rest shows a gap that this part does not: diagnose that alone" if overlooks(problem, best) else ""
    return (found + more,)
