"""Rivals: the explanations that the logs of a case do not tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from exodrake.diagnosis.isolation import Isolation
from exodrake.diagnosis.linearise import with_effects
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.refine import STEPS, TOL, Explanation, minimise
from exodrake.diagnosis.result import AMBIGUOUS, RETUNE
from exodrake.diagnosis.rival import Rival
from exodrake.diagnosis.select import NormalMatrix
from exodrake.diagnosis.verdict import Decision


def rivals_of(problem: Problem, found: Isolation, decision: Decision, alike: Sequence[str]) -> tuple[Rival, ...]:
    """The explanations still in play after a decision, best first; none for a single one.

    Args:
        problem: the case.
        found: its isolation.
        decision: its verdict.
        alike: ids of the effects that explain as much as retuning does.
    """
    if decision.verdict == AMBIGUOUS:
        return tuple(rival(problem, t.explanation) for t in decision.left)
    if decision.verdict == RETUNE and alike:
        singles = [fitted_alone(found, effect) for effect in alike]
        return tuple(rival(problem, e) for e in (decision.best.explanation, *singles))
    return ()


def rival(problem: Problem, e: Explanation) -> Rival:
    """An explanation as the parameters by which its robot differs from the nominal one."""
    nominal, values = replace(problem, detected=()).silent(), e.robot
    names = [p.name for p in problem.robot.machine.parameters]
    return Rival(e.effects, {names[i]: float(values[i]) for i in np.flatnonzero(values != nominal)})


def fitted_alone(found: Isolation, effect: str) -> Explanation:
    """A single effect in place of the moves of the nominal parameters, fitted with these from their nominal values."""
    lin, nominal = found.tests.lin, found.nominal.explanation
    likelihood = found.likelihood.scaled_to(nominal.residual)
    fixed = replace(nominal, parameters=(), x=np.zeros(0), jacobian=np.zeros((0, len(nominal.residual))))
    best = next(p for p in NormalMatrix(likelihood, fixed, lin).singles() if p.probes[0].effect == effect)
    (probe,), (factors,), machine = best.probes, best.factors, likelihood.robot.machine
    parameters = nominal.parameters + probe.parameters
    values = with_effects(nominal.values, [(machine, machine.effect(effect))])
    start = Explanation((effect,), parameters, nominal.x, values, nominal.residual, lin.jacobian)
    x = np.clip(np.r_[nominal.x, probe.coordinates(factors)], *start.bounds)
    return minimise(likelihood, start.at(likelihood, x), STEPS, TOL)
