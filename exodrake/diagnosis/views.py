"""Two views of a case, and the search in each.

Closed: the robot runs its own loop on the references, as it will be used. This view decides whether there is a gap, and
how far it closes. Where the loop hunts (a dead zone, friction at a sensor) its noise decides when it slips, which no
simulation repeats. Steered (`Machine.steered`): the simulation takes the commands that were logged, and its drives are
held near the logged strokes, so that each part answers for its own error only, as in prediction-error identification
(Ljung, System Identification, ch. 7 and 13). It is asked where the closed view leaves something.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from exodrake.diagnosis.decide import Decision, Thresholds, decide, explains, is_quiet, left_over, misfit
from exodrake.diagnosis.deeper import deeper
from exodrake.diagnosis.drops import lossy
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, RETUNE
from exodrake.diagnosis.search import LOSING, Fitted, Progress, Ranking, Search

CLEARLY = 0.75  # of what the closed view leaves, at most: what the steered one must leave to count


@dataclass(frozen=True, eq=False)
class View:
    """A problem, what was tried on it, and what follows."""

    problem: Problem
    ranking: Ranking
    search: Search
    decision: Decision

    @property
    def left(self) -> float:
        """Share of the gap that the decision's best candidate leaves."""
        return left_over(self.problem, self.decision.best, self.search.retuned)

    def polished(self) -> View:
        """The view with the candidate that it names fitted to the end, as its parameters are to be stated."""
        if self.decision.verdict not in (NAMED, AMBIGUOUS) or self.search.shaking:
            return self
        best = self.ranking.polished(self.decision.best)
        return replace(self, decision=replace(self.decision, best=best))


def looked(problem: Problem, limits: Thresholds, progress: Progress = lambda _: None) -> tuple[View, View]:
    """The closed view, and the one whose decision counts: the steered one where it names what leaves less."""
    ranking = Ranking(problem, progress)
    search = closed_search(problem, ranking, limits)
    closed = View(problem, ranking, search, decide(problem, search, limits))
    if settles(closed, limits):
        return closed, closed
    steered = steered_view(closed, limits, progress)
    if steered and steered.decision.verdict in (NAMED, AMBIGUOUS) and steered.left < CLEARLY * closed.left:
        return closed, steered
    return closed, closed


def settles(view: View, limits: Thresholds) -> bool:
    """Whether a view explains a case so well that no other is asked."""
    if view.decision.verdict in (NO_GAP, RETUNE) or view.search.shaking:
        return True
    return misfit(view.problem, view.decision.best) <= limits.near or view.left <= limits.form


def closed_search(problem: Problem, ranking: Ranking, limits: Thresholds) -> Search:
    """Nominal, retuned, then effects and pairs as far as the gap asks for them."""
    nominal = ranking.nominal()
    if is_quiet(problem, nominal, limits):
        return Search(nominal, nominal)
    retuned = ranking.retuned()
    if retuned.misfit <= limits.quiet and not is_quiet(problem, retuned, limits):
        whole = ranking.tuned_to_all()
        retuned = whole if is_quiet(problem, whole, limits) else retuned
    shaking = None if is_quiet(problem, retuned, limits) else ranking.shaking(retuned)
    if shaking:
        return Search(nominal, retuned, shaking=shaking)
    search = causes(problem, ranking, Search(nominal, retuned), limits)
    if misfit(problem, search.singles[0]) > limits.near and (shaking := ranking.shaking(search.singles[0])):
        return replace(search, shaking=shaking)
    return search


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
    return View(problem, ranking, search, replace(decision, reasons=(*decision.reasons, STEERED)))


STEERED = "found with the simulation steered by the logs: in closed loop, noise decides when this robot moves"


def causes(problem: Problem, ranking: Ranking, known: Search, limits: Thresholds) -> Search:
    """Single effects, and second ones where the best single one leaves something."""
    retuned = known.retuned

    def beside(first: Fitted) -> list[Fitted]:
        return worth(problem, first, ranking.pairs(first), retuned, limits)

    singles, screened = ranking.singles(quiet=is_quiet(problem, retuned, limits))
    found = replace(known, singles=tuple(singles), screened=tuple(screened))
    if is_quiet(problem, singles[0], limits):
        return found
    several = problem.robot.machine.depth > 2  # where causes come in threes the first one may do little
    hopeful = several or left_over(problem, singles[0], retuned) <= limits.vain
    pairs = beside(singles[0]) if hopeful else []
    if pairs and (other := ranking.second_alone(pairs[0])).score < singles[0].score:
        singles = sorted((*singles, other), key=lambda f: f.score)
        if misfit(problem, other) > limits.near:
            pairs += beside(other)
            pairs.sort(key=lambda f: f.score)
    if several:
        pairs += deeper(problem, ranking, pairs, limits)
    best = min((*singles, *pairs), key=lambda f: f.score)
    losing = not explains(problem, best, retuned, limits) and lossy([t.drops for t in problem.fit if t.drops])
    if losing and LOSING not in best.point.hypothesis.effects:
        first = ranking.losing(singles)
        singles = sorted({f.name: f for f in (*singles, first)}.values(), key=lambda f: f.score)
        pairs += beside(first)
    return replace(found, singles=tuple(singles), pairs=tuple(pairs), lossy=losing)


def worth(problem: Problem, single: Fitted, pairs: list[Fitted], retuned: Fitted, limits: Thresholds) -> list[Fitted]:
    """Pairs whose second effect removes enough of what the first leaves: all of it where the first explains the case
    but for its law.
    """
    if misfit(problem, single) <= limits.near:
        return [f for f in pairs if left_over(problem, f, single) < limits.second and is_quiet(problem, f, limits)]
    of_law = left_over(problem, single, retuned) <= limits.form and misfit(problem, single) <= limits.law
    share = limits.pair_of_law if of_law else limits.pair
    return [f for f in pairs if left_over(problem, f, single) < share]
