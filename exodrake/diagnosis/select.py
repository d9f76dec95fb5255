"""Selection by algebra: every effect by small bounded least squares on one normal matrix.

Nominal parameters and parameters of effects that are already fitted are linear about their fit. They are eliminated in
closed form (Schur complement; variable projection, Golub & Pereyra 1973). A least-squares problem in one to some twenty
factors is left for each set of effects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.linearise import Linearisation, Probe
from exodrake.diagnosis.projection import Projection
from exodrake.diagnosis.refine import Explanation, bounded


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
        project = Projection(likelihood, known, lin)
        residual, pull = project.pull(known.residual[None], known.use[None])
        self.probes, self.x, self.curvature = project.probes, known.x, project.curvature
        self.slope = project.slopes(residual, pull)[:, 0]
        self.solved = np.concatenate([project.solved, project.inverse @ pull], axis=1)
        self.base = known.cost(likelihood) - 0.5 * float(pull[:, 0] @ self.solved[:, -1])

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
