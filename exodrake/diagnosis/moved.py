"""Nominal parameters that retuning moved, and single effects that explain as much without retuning."""

from __future__ import annotations

import numpy as np

from exodrake.diagnosis.isolation import Isolation
from exodrake.diagnosis.refine import Explanation
from exodrake.diagnosis.result import Moved, Retune
from exodrake.diagnosis.select import NormalMatrix

VISIBLE = 1.0  # standard deviations of the tolerance from which a change is listed
ALIKE = 0.9  # share of what retuning explains from which a single effect is listed


def retuned(found: Isolation) -> Retune:
    """Result of retuning in an isolation: moved parameters, and effects that explain as much."""
    return Retune(moved(found), alike(found))


def moved(found: Isolation) -> tuple[Moved, ...]:
    """Nominal parameters that moved visibly, largest change first."""
    e, infos = found.retuned.explanation, found.likelihood.robot.machine.parameters
    changes = []
    for parameter, x in zip(e.parameters, e.x, strict=True):
        deviations = float(x / parameter.prior_std)
        if abs(deviations) > VISIBLE:
            i = parameter.index[0]
            before, after = float(e.values[i]), float(e.robot[i])
            changes.append(Moved(parameter.name, before, after, infos[i].unit, deviations))
    return tuple(sorted(changes, key=lambda m: -abs(m.deviations)))


def alike(found: Isolation) -> dict[str, float]:
    """Effects that explain alone what retuning explains, each with its share, largest first."""
    tests, nominal = found.tests, found.nominal.explanation
    if not tests.lin.probes or found.retuned.explanation is nominal:
        return {}
    fixed = Explanation((), (), np.zeros(0), nominal.values, nominal.residual, np.zeros((0, len(nominal.residual))))
    likelihood = tests.likelihood.scaled_to(nominal.residual)
    before = fixed.cost(likelihood)
    gain = before - likelihood.cost(found.retuned.explanation.residual, np.zeros(0), np.zeros(0))
    if gain <= 0.0:
        return {}
    singles = NormalMatrix(likelihood, fixed, tests.lin).singles()
    shares = {p.probes[0].effect: min((before - p.cost) / gain, 1.0) for p in singles}
    return {effect: float(share) for effect, share in shares.items() if share > ALIKE}
