"""Causes that come in threes and more: forward search beyond pairs, then what has become superfluous is dropped.

Only for a machine whose `depth` asks for it. A further effect must predict some signal better, on logs that it was not
fitted to as well as on its own: one that sits on a single joint does little for the whole. One that was chosen early is
dropped if the others explain as much without it.
"""

from __future__ import annotations

import numpy as np

from exodrake.core.progress import Stage
from exodrake.diagnosis.hypothesis import Hypothesis
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.search import Fitted, Ranking
from exodrake.diagnosis.verdict import Thresholds, chi2

BETTER = 0.85  # of what is left in a signal, at most, on fitted and on held-out logs: assumed
SPARE = 1.02  # a set without one effect that leaves at most this many times what the whole set leaves does as well
ROUNDS = 3  # of fitting after an effect was dropped, responses taken anew


def larger_sets(problem: Problem, ranking: Ranking, found: list[Fitted], limits: Thresholds) -> list[Fitted]:
    """Sets of three and more effects, each grown from the best one before, and the last one without what is
    superfluous.
    """
    grown: list[Fitted] = []
    best = min(found, key=lambda f: f.score, default=None)
    for _ in range(problem.robot.machine.max_effects - 2):
        if best is None or chi2(problem, best) <= limits.near:
            break
        further = [f for f in ranking.pairs(best) if f.score < best.score and predicts_better(problem, f, best, limits)]
        if not further:
            break
        best = min(further, key=lambda f: f.score)
        grown.append(best)
    leaner = pruned(problem, ranking, grown[-1]) if grown else []
    return [*grown[:-1], *leaner] if leaner else grown


def predicts_better(problem: Problem, fitted: Fitted, before: Fitted, limits: Thresholds) -> bool:
    """Whether a candidate leaves clearly less than `before` of a signal away from its noise, fitted and held-out."""
    columns = len(problem.columns)
    shares, heard = [], []
    for now, was in ((fitted.point.residual, before.point.residual), (fitted.held, before.held)):
        left, all_of_it = (np.mean(rows.reshape(-1, columns) ** 2, axis=0) for rows in (now, was))
        heard.append(all_of_it > limits.near)
        shares.append((left - 1.0) / np.maximum(all_of_it - 1.0, limits.near - 1.0))
    return bool(np.any(np.all(heard, axis=0) & (np.max(shares, axis=0) <= BETTER)))


def pruned(problem: Problem, ranking: Ranking, best: Fitted) -> list[Fitted]:
    """The set without its superfluous effects; empty if all are needed."""
    dropped: list[Fitted] = []
    for identity in best.point.hypothesis.effects:
        kept = dropped[-1] if dropped else best
        if len(kept.point.hypothesis.effects) < 2:
            break
        less = without(ranking, kept, identity)
        if chi2(problem, less) - 1.0 <= SPARE * (chi2(problem, kept) - 1.0):
            dropped.append(less)
    return dropped[-1:]


def without(ranking: Ranking, fitted: Fitted, identity: str) -> Fitted:
    """A set of effects fitted anew without one of them."""
    point, fitter = fitted.point, ranking.full
    ranking.progress(Stage.FIT, f"without {identity}")
    keep = [i for i, coordinate in enumerate(point.hypothesis.coordinates) if coordinate.effect != identity]
    index = ranking.full.problem.robot.machine.index
    held = tuple((place, v) for place, v in point.hypothesis.held if place not in own_places(index, identity))
    less = Hypothesis(
        tuple(e for e in point.hypothesis.effects if e != identity),
        tuple(point.hypothesis.coordinates[i] for i in keep),
        held,
    )
    here = fitter.at(less, point.u[np.array(keep, dtype=int)], point.x)
    for _ in range(ROUNDS):
        ranking.own[less.name] = fitter.responses(here)
        here = fitter.fit(here, ranking.own[less.name], steps=6)
    return ranking.complete(here)


def own_places(index: dict[str, int], identity: str) -> set[int]:
    """Places of an effect's numbers."""
    return {place for name, place in index.items() if name.startswith(f"{identity}.")}
