"""Two views of a case, and the search in each.

Closed: the robot runs its own loop on the references, as it will be used. This view decides whether there is a gap, and
how far it closes. Where the loop hunts (a dead zone, friction at a sensor) its noise decides when it slips, which no
simulation repeats. Steered (`Machine.steered`): the simulation takes the commands that were logged, and its drives are
held near the logged strokes, so that each part answers for its own error only, as in prediction-error identification
(Ljung, System Identification, ch. 7 and 13). It is asked where the closed view leaves something.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from exodrake.diagnosis.decide import Decision, Thresholds, as_good, decide, explains, is_quiet, left_over, misfit
from exodrake.diagnosis.deeper import deeper
from exodrake.diagnosis.drops import lossy
from exodrake.diagnosis.line import WINGS, Line, Tremor, seen, tremor
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, RETUNE, UNKNOWN
from exodrake.diagnosis.search import LOSING, Fitted, Progress, Ranking, Search

STRAINED = 1.0  # mean square of the nominal numbers in units of their spread, beyond which they hide something
CLEARLY = 0.75  # of what the closed view leaves, at most: what the steered one must leave to count


@dataclass(frozen=True, eq=False)
class View:
    """A problem, what was tried on it, and what follows; `tremor`: one that is in its runs, and its band left out."""

    problem: Problem
    ranking: Ranking
    search: Search
    decision: Decision
    tremor: Tremor | None = None

    @property
    def left(self) -> float:
        """Share of the gap that the decision's best candidate leaves."""
        return left_over(self.problem, self.decision.best, self.search.retuned)

    @cached_property
    def values(self) -> np.ndarray:
        """Flat numbers of the best candidate, a tremor aside."""
        point = self.decision.best.point
        return self.ranking.full.values(point.hypothesis, point.u, point.x)

    def polished(self) -> View:
        """The view with what it names settled, as its parameters are to be stated."""
        best = self.decision.best
        if self.decision.verdict not in (NAMED, AMBIGUOUS) or not best.point.hypothesis.effects:
            return self
        return replace(self, decision=replace(self.decision, best=self.ranking.polished(best)))


def looked(problem: Problem, limits: Thresholds, progress: Progress = lambda _: None) -> tuple[View, View]:
    """The closed view, and the one whose decision counts: the steered one where it names what leaves less."""
    closed = closed_view(problem, limits, progress)
    if settles(closed, limits):
        return closed, closed
    steered = steered_view(closed, limits, progress)
    if steered and steered.decision.verdict in (NAMED, AMBIGUOUS) and steered.left < CLEARLY * closed.left:
        return closed, steered
    return closed, closed


def settles(view: View, limits: Thresholds) -> bool:
    """Whether a view explains a case so well that no other is asked."""
    if view.decision.verdict in (NO_GAP, RETUNE) or not view.decision.best.point.hypothesis.effects:
        return True
    return misfit(view.problem, view.decision.best) <= limits.near or view.left <= limits.form


def closed_view(problem: Problem, limits: Thresholds, progress: Progress) -> View:
    """Nominal, retuned, then effects and pairs as far as the gap asks for them; beside a tremor, if one is seen."""
    ranking = Ranking(problem, progress)
    search = tuned_search(problem, ranking, limits)
    if line := seen(problem, search.retuned.point):
        tuned = View(problem, ranking, search, Decision(RETUNE, search.retuned, (), {}, ()))
        return shaken_view(problem, line, tuned, limits, progress)
    view = view_of(problem, ranking, search, limits)
    if view.decision.verdict == UNKNOWN and (line := seen(problem, view.decision.best.point)):
        return shaken_view(problem, line, view, limits, progress)
    return view


def view_of(problem: Problem, ranking: Ranking, search: Search, limits: Thresholds) -> View:
    """The view once nominal numbers are retuned."""
    if not is_quiet(problem, search.nominal, limits):
        search = causes(problem, ranking, search, limits)
    return View(problem, ranking, search, decide(problem, search, limits))


def tuned_search(problem: Problem, ranking: Ranking, limits: Thresholds) -> Search:
    """The nominal robot, and the retuned one where it is needed."""
    nominal = ranking.nominal()
    if is_quiet(problem, nominal, limits):
        return Search(nominal, nominal)
    retuned = ranking.retuned()
    if retuned.misfit <= limits.quiet and not is_quiet(problem, retuned, limits):
        whole = ranking.tuned_to_all()
        retuned = whole if is_quiet(problem, whole, limits) else retuned
    return Search(nominal, retuned)


def shaken_view(problem: Problem, line: Line, start: View, limits: Thresholds, progress: Progress) -> View:
    """The view without the band of a tremor, which is named with whatever else is. The tremor is in all runs: it keeps
    friction moving.
    """
    progress(f"once more, without the line at {line.frequency:.1f} Hz")
    found = tremor(problem, start.values, line)
    robot = replace(problem.robot, values=found.hypothesis.apply(problem.robot.values, found.u))
    whole, problem = problem, replace(problem, robot=robot).without(line.bands(0.5 / robot.machine.frame))
    ranking = Ranking(problem, progress, start.decision.best.point.x)
    view = view_of(problem, ranking, tuned_search(problem, ranking, limits), limits)
    decision, retuned = view.decision, view.search.retuned
    where = f"a line at {line.frequency:.1f} Hz stands out {line.prominence:.0f}-fold, alike in every log"
    why = f"{where}; its phase wanders, so that there only strength is compared"
    wings = WINGS * float(np.mean(line.power * (whole.floor / problem.floor) ** 2))
    earned = decision.verdict in (NAMED, AMBIGUOUS) and view.left <= limits.pair
    if not earned and misfit(problem, retuned) <= max(limits.near, 1.0 + wings):
        decision = Decision(NAMED, retuned, (retuned,), {}, ())
    return replace(view, decision=replace(decision, reasons=(*decision.reasons, why)), tremor=found)


def steered_view(closed: View, limits: Thresholds, progress: Progress) -> View | None:
    """The search with runs that follow the logs; None where the machine cannot, or where nothing is left to explain."""
    problem = closed.problem.steered()
    if problem is None:
        return None
    progress("once more, steered by the logs")
    ranking = Ranking(problem, progress, closed.search.retuned.point.x)
    nominal, retuned = ranking.nominal(), ranking.retuned()
    if misfit(problem, retuned) <= limits.near:
        return None
    search = causes(problem, ranking, Search(nominal, retuned), limits)
    decision = decide(problem, search, replace(limits, explained=limits.steered))
    return View(problem, ranking, search, replace(decision, reasons=(*decision.reasons, STEERED)), closed.tremor)


STEERED = "found with the simulation steered by the logs: in closed loop, noise decides when this robot moves"


def causes(problem: Problem, ranking: Ranking, known: Search, limits: Thresholds) -> Search:
    """Single effects, and second ones where the best single one leaves something."""
    retuned = known.retuned
    quiet = is_quiet(problem, retuned, limits)
    singles, screened = ranking.singles(quiet)
    if quiet and retuned.score - singles[0].score >= limits.alarm:
        # an effect must beat numbers that are settled, not a fit that stopped early
        retuned = ranking.polished(retuned)
    found = replace(known, retuned=retuned, singles=tuple(singles), screened=tuple(screened))
    if is_quiet(problem, singles[0], limits) and ranking.full.strain(singles[0].point) <= STRAINED:
        return found
    several = problem.robot.machine.depth > 2  # where causes come in threes the first one may do little
    hopeful = several or left_over(problem, singles[0], retuned) <= limits.vain
    tried = ranking.pairs(singles[0]) if hopeful else []
    pairs = worth(problem, singles[0], tried, retuned, limits)
    if pairs:
        other = ranking.second_alone(pairs[0])
        better = other.score < singles[0].score
        singles = sorted((*singles, other), key=lambda f: f.score) if better else singles
        if (better or left_over(problem, pairs[0], retuned) > limits.form) and misfit(problem, other) > limits.near:
            tried = once([*tried, *ranking.pairs(other)])
        pairs = worth(problem, singles[0], tried, retuned, limits)
        pairs = once([*pairs, *alternatives(problem, ranking, singles, pairs, limits)])
    if several:
        pairs += deeper(problem, ranking, pairs, limits)
    best = min((*singles, *pairs), key=lambda f: f.score)
    losing = not explains(problem, best, retuned, limits) and lossy([t.drops for t in problem.fit if t.drops])
    if losing and LOSING not in best.point.hypothesis.effects:
        first = ranking.losing(singles)
        singles = sorted({f.name: f for f in (*singles, first)}.values(), key=lambda f: f.score)
        pairs += worth(problem, first, ranking.pairs(first), retuned, limits)
    return replace(found, singles=tuple(singles), pairs=tuple(pairs), lossy=losing)


def alternatives(
    problem: Problem, ranking: Ranking, singles: list[Fitted], pairs: list[Fitted], limits: Thresholds
) -> list[Fitted]:
    """The best pair with its first effect replaced by each that is as good alone."""
    if not pairs:
        return []
    best = min(pairs, key=lambda f: f.score)
    first, tried = best.point.hypothesis.effects[0], {f.name for f in pairs}
    alone = next((f for f in singles if f.name == first), None)
    rivals = [f for f in singles if alone and f is not alone and as_good(problem, f, alone, limits)]
    second = best.point.hypothesis.effects[-1]
    wanted = [f for f in rivals if f.name != second and f"{f.name} + {second}" not in tried]
    return [ranking.second_beside(best, f) for f in wanted]


def once(pairs: list[Fitted]) -> list[Fitted]:
    """The best fit of each set of effects, whatever their order; best first."""
    found: dict[frozenset[str], Fitted] = {}
    for pair in sorted(pairs, key=lambda f: f.score):
        found.setdefault(frozenset(pair.point.hypothesis.effects), pair)
    return list(found.values())


def worth(problem: Problem, single: Fitted, pairs: list[Fitted], retuned: Fitted, limits: Thresholds) -> list[Fitted]:
    """Pairs whose second effect removes enough of what the first leaves: where that is next to nothing, the second one
    must relieve the nominal numbers or leave less, by far more than any other does; where it is another law, all of it,
    or more than any other could.
    """

    def left(pair: Fitted) -> float:
        return left_over(problem, pair, single)

    if misfit(problem, single) <= limits.near:
        return relieving(single, pairs, limits)
    if left_over(problem, single, retuned) > limits.explained:
        return [f for f in pairs if left(f) < limits.pair]
    match sorted(pairs, key=left):
        case [best, second, *_] if left(best) < min(limits.distinct_of_law, left(second) / limits.distinct):
            return [best]
    return [f for f in pairs if left(f) < limits.of_law]


def relieving(single: Fitted, pairs: list[Fitted], limits: Thresholds) -> list[Fitted]:
    """Pairs with a second effect that lowers the cost by much, and by far more than those of any other block do."""
    if not pairs:
        return []

    def gain(pair: Fitted) -> float:
        return single.score - pair.score

    def block(pair: Fitted) -> str:
        return pair.point.hypothesis.effects[-1].split(".")[0]

    best = max(pairs, key=gain)
    other = max((gain(f) for f in pairs if block(f) != block(best)), default=0.0)
    if gain(best) < max(limits.second, limits.far * other):
        return []
    return [f for f in pairs if block(f) == block(best) and gain(f) > limits.second]
