"""Selection by algebra: every effect and every pair, by small bounded least squares on one normal matrix.

Nominal parameters, and those of effects that are known already, are linear about their fit and are eliminated in closed
form (Schur complement; variable projection, Golub & Pereyra 1973). What is left is a least-squares problem in one to
some twenty factors for each set of effects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.linearise import Linearisation, Probe
from exodrake.diagnosis.refine import Explanation, bounded, effect_columns


@dataclass(frozen=True, eq=False)
class Predicted:
    """A set of effects as the linearisation predicts it.

    Attributes:
        probes: one for each effect.
        factors: factors of the directions of each probe.
        cost: predicted cost.
        x: (eliminated,) coordinates of the eliminated parameters.
    """

    probes: tuple[Probe, ...]
    factors: tuple[np.ndarray, ...]
    cost: float
    x: np.ndarray


class NormalMatrix:
    """The cost of factors f of effect directions beside an explanation: base + f's + f'Sf / 2, all else eliminated.

    Args:
        likelihood: views with their weights.
        known: explanation whose parameters are eliminated.
        lin: linearisation that holds the directions.
    """

    def __init__(self, likelihood: Likelihood, known: Explanation, lin: Linearisation) -> None:
        weights = likelihood.weights
        columns = np.concatenate([known.jacobian, effect_columns(likelihood, known)]).astype(np.float32) * weights
        directions, residual = lin.directions * weights, (known.residual * weights).astype(np.float32)
        self.probes, self.x = [p for p in lin.probes if p.effect not in known.effects], known.x
        precision = 1.0 / known.prior_std**2
        normal = (columns @ columns.T).astype(float) + np.diag(precision)
        pull = (columns @ residual).astype(float) + precision * known.x
        cross = (columns @ directions.T).astype(float)
        self.solved = np.linalg.solve(normal + 1e-9 * np.diag(np.diag(normal)), np.c_[cross, pull])
        self.curvature = (directions @ directions.T).astype(float) - cross.T @ self.solved[:, :-1]
        self.slope = (directions @ residual).astype(float) - cross.T @ self.solved[:, -1]
        self.base = likelihood.cost(known.residual, known.x, known.prior_std) - 0.5 * float(pull @ self.solved[:, -1])

    def predicted(self, probes: Sequence[Probe]) -> Predicted:
        """The best factors of some probes, within their ranges."""
        rows = np.concatenate([probe.rows for probe in probes])
        low, high = (np.concatenate([getattr(probe, end) for probe in probes]) for end in ("low", "high"))
        factors, gain = bounded(self.curvature[np.ix_(rows, rows)], self.slope[rows], low, high)
        move = -(self.solved[:, -1] + self.solved[:, rows] @ factors)
        cuts = np.cumsum([len(probe.rows) for probe in probes])[:-1]
        return Predicted(tuple(probes), tuple(np.split(factors, cuts)), self.base + gain, self.x + move)

    def singles(self) -> list[Predicted]:
        """The best probe of each effect, best effect first."""
        best: dict[str, Predicted] = {}
        for probe in self.probes:
            found = self.predicted([probe])
            if probe.effect not in best or found.cost < best[probe.effect].cost:
                best[probe.effect] = found
        return sorted(best.values(), key=lambda p: p.cost)

    def pairs(self) -> list[Predicted]:
        """All pairs of the best probes of effects, best pair first."""
        found = [self.predicted([a.probes[0], b.probes[0]]) for a, b in combinations(self.singles(), 2)]
        return sorted(found, key=lambda p: p.cost)
