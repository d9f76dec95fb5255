"""Result of a detector: an effect that shows in a log before any fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from exodrake.diagnosis.result import NamedEffect

if TYPE_CHECKING:
    import numpy as np

    from exodrake.diagnosis.problem import Problem
    from exodrake.diagnosis.trial import Trial


@dataclass(frozen=True)
class Detection:
    """An effect that a detector found.

    Attributes:
        effect: effect as the answer states it.
        values: parameter name -> value [SI] that all further robots have; none for an effect that remains a candidate
            of the fits.
        reason: how it was found, in one sentence.
        noise: draws what a log shows of the effect beyond its simulation, by the problem, the parameters (parameters,)
            of a robot, a trial and a random generator: (n, columns) [SI]. None if the simulation shows it all.
    """

    effect: NamedEffect
    values: dict[str, float]
    reason: str
    noise: Callable[[Problem, np.ndarray, Trial, np.random.Generator], np.ndarray] | None = None

    @property
    def certain(self) -> bool:
        """Whether the effect is there, whatever a fit finds."""
        return bool(self.values)
