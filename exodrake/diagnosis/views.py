"""Two views of a case, and the search in each.

Closed: the robot runs its own loop on the references, as it will be used. This view decides whether there is a gap, and
how far it closes. Where the loop hunts (a dead zone, friction at a sensor) its noise decides when it slips, which no
simulation repeats. Steered (`Machine.observer`): the simulation takes the commands that were logged, and its drives are
held near the logged strokes, so that each part answers for its own error only, as in prediction-error identification
(Ljung, System Identification, ch. 7 and 13). It is asked where the closed view leaves something.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.diagnosis.detect.packet_loss import evident
from exodrake.diagnosis.larger_sets import larger_sets
from exodrake.diagnosis.line import LEAKAGE, Line, Tremor, seen, tremor
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, RETUNE, UNKNOWN
from exodrake.diagnosis.search import PACKET_LOSS, STRAINED, Ranking, Search
from exodrake.diagnosis.second_effects import clearly_best, with_packet_loss, with_second_effects
from exodrake.diagnosis.verdict import Decision, Thresholds, chi2, decide, is_consistent, left_over

CLEARLY = 0.75  # of what the closed view leaves, at most: what the prediction-error one must leave to count


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

    def converged(self) -> View:
        """The view with what it names minimised, as its parameters are to be stated."""
        best = self.decision.best
        if self.decision.verdict not in (NAMED, AMBIGUOUS) or not best.point.hypothesis.effects:
            return self
        return replace(self, decision=replace(self.decision, best=self.ranking.converged(best)))


def analyse(problem: Problem, limits: Thresholds, progress: StageProgress = no_progress) -> tuple[View, View]:
    """The closed view, and the one whose decision counts: the prediction-error one where it names what leaves less."""
    closed = closed_view(problem, limits, progress)
    if settles(closed, limits):
        return closed, closed
    prediction_error = prediction_error_view(closed, limits, progress)
    if (
        prediction_error
        and prediction_error.decision.verdict in (NAMED, AMBIGUOUS)
        and prediction_error.left < CLEARLY * closed.left
    ):
        return closed, prediction_error
    return closed, closed


def settles(view: View, limits: Thresholds) -> bool:
    """Whether a view explains a case so well that no other is asked."""
    if view.decision.verdict in (NO_GAP, RETUNE) or not view.decision.best.point.hypothesis.effects:
        return True
    return chi2(view.problem, view.decision.best) <= limits.near or view.left <= limits.form


def closed_view(problem: Problem, limits: Thresholds, progress: StageProgress) -> View:
    """Nominal, retuned, then effects and pairs as far as the gap asks for them; beside a tremor, if one is seen."""
    ranking = Ranking(problem, progress)
    search = tuned_search(problem, ranking, limits)
    if line := seen(problem, search.retuned.point):
        tuned = View(problem, ranking, search, Decision(RETUNE, search.retuned, (), {}, ()))
        return notched_view(problem, line, tuned, limits, progress)
    view = view_of(problem, ranking, search, limits)
    if view.decision.verdict == UNKNOWN and (line := seen(problem, view.decision.best.point)):
        return notched_view(problem, line, view, limits, progress)
    return view


def view_of(problem: Problem, ranking: Ranking, search: Search, limits: Thresholds) -> View:
    """The view once nominal numbers are retuned."""
    if not is_consistent(problem, search.nominal, limits):
        search = causes(problem, ranking, search, limits)
    return View(problem, ranking, search, decide(problem, search, limits))


def tuned_search(problem: Problem, ranking: Ranking, limits: Thresholds) -> Search:
    """The nominal robot, and the retuned one where it is needed."""
    nominal = ranking.nominal()
    if is_consistent(problem, nominal, limits):
        return Search(nominal, nominal)
    retuned = ranking.retuned()
    if retuned.chi2 <= limits.consistent and not is_consistent(problem, retuned, limits):
        whole = ranking.tuned_to_all()
        retuned = whole if is_consistent(problem, whole, limits) else retuned
    return Search(nominal, retuned)


def notched_view(problem: Problem, line: Line, start: View, limits: Thresholds, progress: StageProgress) -> View:
    """The view without the band of a tremor, which is named with whatever else is. The tremor is in all runs: it keeps
    friction moving.
    """
    progress(Stage.REPEAT, f"without the spectral peak at {line.frequency:.1f} Hz")
    found = tremor(problem, start.values, line)
    robot = replace(problem.robot, values=found.hypothesis.apply(problem.robot.values, found.u))
    whole, problem = problem, replace(problem, robot=robot).without(line.bands(0.5 / robot.machine.frame))
    ranking = Ranking(problem, progress, start.decision.best.point.x)
    view = view_of(problem, ranking, tuned_search(problem, ranking, limits), limits)
    decision, search, retuned = view.decision, view.search, view.search.retuned
    where = f"a line at {line.frequency:.1f} Hz stands out {line.prominence:.0f}-fold, alike in every log"
    why = f"{where}; its phase wanders, so that there only strength is compared"
    leakage = LEAKAGE * float(np.mean(line.power * (whole.noise_std / problem.noise_std) ** 2))
    earned = decision.verdict in (NAMED, AMBIGUOUS) and view.left <= limits.pair
    if not earned and search.singles and clearly_best(retuned, search.singles, limits):
        decision, earned = decide(problem, search, replace(limits, explained=1.0)), True
    if not earned and chi2(problem, retuned) <= max(limits.near, 1.0 + leakage):
        decision = Decision(NAMED, retuned, (retuned,), {}, ())
    return replace(view, decision=replace(decision, reasons=(*decision.reasons, why)), tremor=found)


def prediction_error_view(closed: View, limits: Thresholds, progress: StageProgress) -> View | None:
    """The search with runs that follow the logs; None where the machine cannot, or where nothing is left to explain."""
    problem = closed.problem.prediction_error()
    if problem is None:
        return None
    progress(Stage.REPEAT, "with output injection from the logs")
    ranking = Ranking(problem, progress, closed.search.retuned.point.x)
    nominal, retuned = ranking.nominal(), ranking.retuned()
    if chi2(problem, retuned) <= limits.near:
        return None
    search = causes(problem, ranking, Search(nominal, retuned), limits)
    decision = decide(problem, search, replace(limits, explained=limits.prediction_error))
    decision = replace(decision, reasons=(*decision.reasons, PREDICTION_ERROR))
    return View(problem, ranking, search, decision, closed.tremor)


PREDICTION_ERROR = "found in prediction error, fed with the logs: in closed loop, noise decides when this robot moves"


def causes(problem: Problem, ranking: Ranking, known: Search, limits: Thresholds) -> Search:
    """Single effects, and second ones where the best single one leaves something."""
    retuned = known.retuned
    singles, screened = ranking.singles(is_consistent(problem, retuned, limits))
    found = replace(known, singles=tuple(singles), screened=tuple(screened))
    if is_consistent(problem, singles[0], limits) and ranking.full.nuisance_chi2(singles[0].point) <= STRAINED:
        return found
    singles, pairs = with_second_effects(problem, ranking, singles, retuned, limits)
    if problem.robot.machine.max_effects > 2:
        pairs += larger_sets(problem, ranking, pairs, limits)
    packet_loss = PACKET_LOSS in problem.tried and evident([t.losses for t in problem.fit if t.losses])
    if packet_loss:
        singles, pairs = with_packet_loss(problem, ranking, singles, pairs, retuned, limits)
    return replace(found, singles=tuple(singles), pairs=tuple(pairs), losses_evident=packet_loss)
