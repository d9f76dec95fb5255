"""Pruning: removal of effects that a set does not need, since the first effect may stand for later ones.

    while an effect of a kept set of three or more, or of every kept set, may as well be absent:
        fit the set without it; go on with that if the logs do not reject it and the larger set does not beat it

Smaller sets were tried before. Where no kept set needs all of its effects, the fit of a smaller set ended in another
minimum. An effect of nearly zero amplitude may lead the nominal parameters out of such a minimum.

Whether an effect may as well be absent is asked of the curvature at the fit, which says nothing beside the threshold of
a dead zone. Then the fit without the effect answers: a set that it cannot replace needs its effects.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from exodrake.diagnosis.intervals import Fitted
from exodrake.diagnosis.isolation import Isolation, Tested, tested
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.linearise import without_effect
from exodrake.diagnosis.refine import STEPS, TOL, Explanation, minimise

LEAST = 3  # effects of a set that is looked at where others need all of theirs


def spurious(t: Tested, fit: Fitted, counted: Collection[str]) -> list[str]:
    """Effects of an explanation that may as well be absent; those that were counted are not."""
    return [effect for effect in t.explanation.effects if effect not in counted and fit.of(effect).holds_null()]


def pruned(found: Isolation) -> Isolation:
    """The isolation whose kept sets have no effect that they do not need."""
    counted = found.likelihood.views[0].problem.counted
    all_spurious = all(spurious(t, found.fitted(t), counted) for t in found.left if t.explanation.effects)
    least = 1 if all_spurious else LEAST
    if not found.left or len(found.left[0].explanation.effects) < least:
        return found
    made = [needed(found, t, counted, least) for t in found.left]
    size = min(len(t.explanation.effects) for t in made)
    smallest = {frozenset(t.explanation.effects): t for t in made if len(t.explanation.effects) == size}
    left = tuple(sorted(smallest.values(), key=lambda t: t.cost))
    new = tuple(t for t in left if t not in found.left)
    if not size:
        return replace(found, retuned=left[0], left=left)
    found = replace(found, irreducible=tuple(t for t in left if t not in new))
    return replace(found, tested=(*found.tested, new), left=left) if new else found


def needed(found: Isolation, t: Tested, counted: Collection[str], least: int) -> Tested:
    """The explanation without the effects that it does not need; one of fewer than `least` as it is."""
    if len(t.explanation.effects) < least:
        return t
    for effect in spurious(t, found.fitted(t), counted):
        likelihood = found.likelihood.for_stage("refine again")
        start = without(likelihood, t.explanation, effect)
        smaller = minimise(likelihood.scaled_to(t.explanation.residual), start, STEPS, TOL)
        (again,) = tested(likelihood, found.tests, [smaller], [t.explanation])
        if again.levels.kept:
            return needed(found, again, counted, least)
    return t


def without(likelihood: Likelihood, e: Explanation, effect: str) -> Explanation:
    """An explanation with one effect at its null value."""
    machine = likelihood.robot.machine
    kept = [i for i, p in enumerate(e.parameters) if p.effect != effect]
    values = e.values
    for row in without_effect(machine, e.values, machine.effect(effect)):
        values = np.where(row != e.values, row, values)
    effects, parameters = tuple(i for i in e.effects if i != effect), tuple(e.parameters[i] for i in kept)
    return replace(e, effects=effects, parameters=parameters, values=values).at(likelihood, e.x[kept])
