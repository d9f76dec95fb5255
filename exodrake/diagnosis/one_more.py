"""One more effect: how much each reduces the cost, in units of what it takes up where it is absent.

An effect with many parameters takes up more of noise and of a law's error than one with few, and one that is like that
error more than another one. Gains are divided by their means under the null, so that the largest of all effects does
not hide what one that takes up little else takes up (step-down tests; Westfall & Young 1993).
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from exodrake.diagnosis.p_values import exceeding
from exodrake.diagnosis.projection import Projection

# p-value and share of the excess from which a further effect is tried. Without one that promises as much a search ends,
# so that it decides on UNKNOWN (`levels`, `isolate`) and on whether a missing law is found (`discovery`)
PROMISING = 0.1


class Gain(NamedTuple):
    """Sum of squares that an effect takes up, with its p-value among all effects."""

    effect: str
    power: float
    p: float


class OneMore:
    """Reductions of the cost of an explanation by one more effect, by the linearisation.

    Args:
        project: of the explanation.
        null: (draws, samples) of what it leaves if no effect is missing; none if it leaves so much that no draw tells.
    """

    def __init__(self, project: Projection, null: np.ndarray | None) -> None:
        self.project, self.effects = project, list(dict.fromkeys(probe.effect for probe in project.probes))
        self.units, self.largest = np.ones(len(self.effects)), None
        if null is not None and self.effects:
            gains = self.gains(null)
            self.units = np.maximum(gains.mean(axis=1), 1e-12)
            self.largest = (gains / self.units[:, None]).max(axis=0)

    def gains(self, rows: np.ndarray) -> np.ndarray:
        """Sum of squares (effects, n) of rows (n, samples) that each effect takes up by the best of its probes."""
        gains, of = self.project.gains(rows), np.array([probe.effect for probe in self.project.probes])
        return np.array([gains[of == effect].max(axis=0) for effect in self.effects])

    def p_value(self, effects: Collection[str], power: float) -> float:
        """p-value of a sum of squares that some effects take up together, one of all that may be missing."""
        if self.largest is None:
            return 0.0 if power > 0.0 else 1.0
        unit = sum(u for u, effect in zip(self.units, self.effects, strict=True) if effect in effects)
        return exceeding(self.largest, power / (unit or float(self.units.max())))

    def most(self, residual: np.ndarray) -> Gain:
        """The effect that takes up most of a residual (samples,), of those whose p-value is promising if any is."""
        if not self.effects:
            return Gain("", 0.0, 1.0)
        powers = self.gains(residual[None])[:, 0]
        found = [Gain(i, float(g), self.p_value({i}, float(g))) for i, g in zip(self.effects, powers, strict=True)]
        telling = [gain for gain in found if gain.p <= PROMISING]
        return max(telling, key=lambda gain: gain.power) if telling else min(found, key=lambda gain: gain.p)
