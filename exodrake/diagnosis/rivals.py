"""What stands beside an answer: parameters that retuning moved, and explanations that the logs do not tell apart."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from exodrake.diagnosis.fit import Explanation, Predicted, fit_beside
from exodrake.diagnosis.isolation import Isolation
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import AMBIGUOUS, RETUNE, Moved, Rival
from exodrake.diagnosis.search import screen
from exodrake.diagnosis.verdict import Decision

VISIBLE = 1.0  # standard deviations of the tolerance from which a change is listed
ALIKE = 0.9  # share of what retuning explains from which a single effect is listed


def moved(found: Isolation) -> tuple[Moved, ...]:
    """Nominal parameters that retuning moved visibly, largest change first."""
    e, infos = found.retuned.explanation, found.likelihood.robot.machine.parameters
    changes = []
    for parameter, x in zip(e.parameters, e.x, strict=True):
        deviations, i = float(x / parameter.prior_std), parameter.index[0]
        if abs(deviations) > VISIBLE:
            before, after = float(e.values[i]), float(e.robot[i])
            changes.append(Moved(parameter.name, before, after, infos[i].unit, deviations))
    return tuple(sorted(changes, key=lambda m: -abs(m.deviations)))


def alike(found: Isolation) -> dict[str, tuple[float, Predicted]]:
    """Single effects that explain what retuning explains, the nominal parameters as they were, largest share first."""
    nominal, retuned, none = found.nominal, found.retuned.explanation, np.zeros(0)
    if not found.lin.probes:
        return {}
    fixed = replace(nominal, parameters=(), x=none, jacobian=nominal.jacobian[:0])
    likelihood = found.likelihood.scaled_to(nominal.residual)
    gain = likelihood.cost(nominal.residual, none, none) - likelihood.cost(retuned.residual, none, none)
    shares = {p.probe.effect: (min(p.gain / gain, 1.0), p) for p in screen(likelihood, fixed, found.lin) if gain > 0.0}
    return {effect: one for effect, one in shares.items() if one[0] > ALIKE}


def rivals_of(problem: Problem, found: Isolation, decision: Decision, others: Iterable[Predicted]) -> tuple[Rival, ...]:
    """The explanations still in play after a decision, the best set first; none where one is left.

    Args:
        problem: the case.
        found: its isolation.
        decision: its verdict.
        others: single effects that explain as much as retuning does.
    """
    best, explanations = decision.best, [decision.best.explanation]
    if decision.verdict == AMBIGUOUS:
        for cause in decision.causes:
            places = found.search.in_place_of(best, cause.effect)
            explanations += [places[i].explanation for i in cause.rivals if i in places]
    if decision.verdict == RETUNE:
        nominal = found.nominal
        likelihood = found.likelihood.scaled_to(nominal.residual).for_stage("refine")
        explanations += fit_beside(likelihood, nominal, [replace(p, x=nominal.x) for p in others])
    return tuple(rival(problem, e) for e in explanations) if len(explanations) > 1 else ()


def rival(problem: Problem, e: Explanation) -> Rival:
    """An explanation as the parameters by which its robot differs from the nominal one."""
    nominal, values = replace(problem, detected=()).silent(), e.robot
    names = [p.name for p in problem.robot.machine.parameters]
    return Rival(e.effects, {names[i]: float(values[i]) for i in np.flatnonzero(values != nominal)})
