"""Isolation: the smallest sets of effects that the logs do not reject (structured hypothesis tests; Nyberg 1999).

    for size in 0, 1, 2, ...:
        left = explanations of that size that the tests of `levels` keep
        stop at the first size that leaves any, once no further effect is promising or the next size beats none

Steps: retune, linearise once, rank all effects by algebra, fit the best few and test them, linearise beside the best.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.diagnosis.comparison import taken_up
from exodrake.diagnosis.fits import Fits
from exodrake.diagnosis.isolation import Isolation, tested
from exodrake.diagnosis.levels import Tests
from exodrake.diagnosis.likelihood import Likelihood, likelihood_of
from exodrake.diagnosis.linearise import Linearisation, linearise, nominal_jacobian, renewed
from exodrake.diagnosis.one_more import PROMISING
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.prune import spurious
from exodrake.diagnosis.refine import STEPS, Explanation
from exodrake.diagnosis.select import NormalMatrix, Predicted

REFINED = 5  # sets of effects of one size that are fitted
EXCHANGED = 2  # other sets than the best one beside which an effect is tried that was found beside the best
RENEWED = 24  # effects whose directions are taken anew beside an explanation, the most promising by the known ones
LOOKED = 8  # the same before a search ends at it, and beside a set that is kept
TRIED = 2  # sets with one effect more that are fitted first beside a set that is kept


class Isolator:
    """One case under test.

    Args:
        problem: shortened case as a regression, with what was detected.
        start: its retuned robot.
        simulated: time simulated so far, by stage [s].
        progress: called with the stage and what it works on.
    """

    def __init__(
        self,
        problem: Problem,
        start: Explanation,
        simulated: defaultdict[str, float],
        progress: StageProgress = no_progress,
    ) -> None:
        self.problem, self.start, self.progress = problem, start, progress
        self.simulated, self.fits = simulated, Fits(problem.robot.machine, progress)
        self.effects = [effect for effect in problem.robot.machine.effects if effect.id in problem.tried]
        self.beside: dict[Explanation, tuple[Linearisation, frozenset[str]]] = {}  # directions, and of which effects

    def isolate(self, max_effects: int) -> Isolation:
        """Explanations of growing size until some are left."""
        start = self.start
        likelihood = likelihood_of(self.problem, start.robot, self.simulated).for_stage("linearise")
        self.progress(Stage.LINEARISE, "")
        lin = linearise(likelihood, start.values, start.x, start.parameters, self.effects)
        start = replace(start, residual=lin.residual, jacobian=lin.jacobian)
        likelihood = likelihood.scaled_to(lin.residual).for_stage("refine")
        retuned = self.fits.refined(likelihood, start, STEPS)
        zero = start.at(likelihood, np.zeros(len(start.x)))
        tests = Tests(likelihood, lin, zero.residual - retuned.residual)
        nominal, best = (tested(likelihood, tests, [e])[0] for e in (zero, retuned))
        found = Isolation(likelihood, tests, nominal, best, lin)
        if found.nominal.levels.sufficient or found.retuned.levels.sufficient or not max_effects or not self.effects:
            return found.without_effects()
        likelihood = likelihood.scaled_to(retuned.residual)
        screened = NormalMatrix(likelihood, retuned, lin).singles()
        singles = self.singles(replace(found, likelihood=likelihood), screened)
        likelihood = likelihood.scaled_to(singles[0].residual) if singles else likelihood
        found = replace(found, likelihood=likelihood, screened=tuple(screened))
        found = replace(found, retuned=tested(likelihood, tests, [retuned], singles)[0])
        if found.nominal.levels.sufficient or found.retuned.levels.kept or found.retuned.levels.burst:
            return found.without_effects()
        found = found.with_round(tested(likelihood, tests, singles))
        if not found.left and found.retuned.levels.moved > found.retuned.levels.most_moved:
            found = self.restarted(found, zero)
        if not found.left and taken_up(likelihood, retuned, found.best.explanation).share < PROMISING:
            return found
        return self.enlarged(found, max_effects)

    def enlarged(self, found: Isolation, max_effects: int) -> Isolation:
        """The isolation with sets of one effect more, until some are left and none larger beats them."""
        while len(found.tested) < max_effects:
            found = self.settled(found)
            found = self.looked_again(found) if found.sufficient else found
            if found.sufficient:
                return found
            if found.left and not self.beaten(found, self.grown(found, LOOKED, TRIED)):
                return found
            larger = self.grown(found)
            if not larger.explanations or (found.left and not self.beaten(found, larger)):
                return found
            again = tested(found.likelihood, found.tests, found.explanations, larger.explanations)
            if any(t.levels.kept for t in again):
                return replace(found, tested=found.tested[:-1]).with_round(again)
            found = larger
        return self.settled(found if found.left else self.swapped(found))

    def swapped(self, found: Isolation) -> Isolation:
        """The isolation with sets in which another effect stands for the first one of the best set.

        The first effect was chosen while nothing stood beside it (floating search; Pudil et al. 1994): a latency may
        stand for a slow velocity loop until friction in the sheaths is there, too.
        """
        others = found.explanations[0].effects[1:]
        parent = next((t for t in (found.tested[-2] if others else ()) if t.explanation.effects == others), None)
        if parent is None:
            return found
        e, known = parent.explanation, {frozenset(known.effects) for known in found.explanations}
        likelihood, _, singles = self.predicted_beside(found, e)
        new = [p for p in singles if frozenset((*e.effects, p.probes[0].effect)) not in known]
        more = [*found.explanations, *self.fits.fitted(likelihood, e, new[:TRIED])]
        best = min(more, key=lambda one: likelihood.mean_log(one.residual))
        found = replace(found, likelihood=likelihood.scaled_to(best.residual), tested=found.tested[:-1])
        return found.with_round(tested(found.likelihood, found.tests, more), found.tested[-1][0])

    def beaten(self, found: Isolation, larger: Isolation) -> bool:
        """Whether the best set is beaten by sets of one effect more, and these need it."""
        best, *_ = tested(found.likelihood, found.tests, found.explanations[:1], larger.explanations)
        return bool(best.levels.beaten_by) and self.needed(larger)

    def settled(self, found: Isolation) -> Isolation:
        """The isolation with its kept sets fitted on with the nominal Jacobian of the best one's robot.

        Fits that left little were spared that, and the Jacobian of the others may be stale. What another effect seems
        to take up may be their own.
        """
        best, *others = found.explanations
        likelihood = found.likelihood.scaled_to(best.residual).for_stage("refine again")
        best, kept = self.fits.settled(likelihood, best), [t.explanation for t in found.left]
        for k, e in enumerate(others):
            if e in kept:
                others[k] = self.fits.refined(likelihood, e.with_jacobian(best.jacobian), STEPS)
        again = tested(likelihood, found.tests, [best, *others])
        parent = found.tested[-2][0] if len(found.tested) > 1 else None
        return replace(found, likelihood=likelihood, tested=found.tested[:-1]).with_round(again, parent)

    def looked_again(self, found: Isolation) -> Isolation:
        """The isolation tested with directions beside its best set, where those beside the retuned robot promise none.

        Behind a current limit or a dead zone another effect acts otherwise than in a robot that lacks them.
        """
        best = found.tested[-1][0].explanation
        likelihood = found.likelihood.scaled_to(best.residual).for_stage("linearise again")
        lin = self.linearised(likelihood, best, found.tests.lin, LOOKED)
        tests, kept = found.tests.beside(found.likelihood, lin), [t.explanation for t in found.left]
        again = tuple(tested(found.likelihood, tests, found.explanations))
        left = tuple(t for t in again if t.explanation in kept and t.levels.kept)
        return replace(found, tests=tests, tested=(*found.tested[:-1], again), left=left)

    def needed(self, larger: Isolation) -> bool:
        """Whether some set of the last size has no effect that may as well be absent, or none is kept."""
        counted = self.problem.counted
        return not larger.left or not all(spurious(t, larger.fitted(t), counted) for t in larger.left)

    def singles(self, found: Isolation, screened: Sequence[Predicted]) -> list[Explanation]:
        """The most promising single effects, fitted, and what would be added to the best of them."""
        likelihood, known = found.likelihood, found.retuned.explanation
        fitted = self.fits.fitted(likelihood, known, screened[:REFINED])
        levels = found.tests(fitted[0])
        further = [p for p in screened[REFINED:] if p.probes[0].effect == levels.next_effect and not levels.sufficient]
        more = [*fitted, *self.fits.fitted(likelihood, known, further, likelihood.mean_log(fitted[0].residual))]
        return sorted(more, key=lambda e: likelihood.mean_log(e.residual))

    def restarted(self, found: Isolation, zero: Explanation) -> Isolation:
        """The isolation with single effects that look best from the nominal robot, where retuning led astray.

        Effects that were fitted from the retuned robot are fitted again: its nominal parameters may imitate them.
        """
        likelihood = found.likelihood.for_stage("linearise again")
        jacobian = nominal_jacobian(likelihood, zero.values, zero.parameters, zero.x, zero.residual)
        zero = zero.with_jacobian(jacobian)
        lin = self.linearised(likelihood.scaled_to(zero.residual), zero, found.tests.lin)
        likelihood = likelihood.for_stage("refine again")
        screened = NormalMatrix(likelihood.scaled_to(zero.residual), zero, lin).singles()
        more = [*found.explanations, *self.fits.fitted(likelihood, zero, screened[:REFINED])]
        best = {e.name: e for e in sorted(more, key=lambda e: -e.cost(likelihood))}
        return replace(found, tested=()).with_round(tested(likelihood, found.tests, list(best.values())))

    def grown(self, found: Isolation, looked: int = RENEWED, fitted: int = REFINED) -> Isolation:
        """The isolation with sets of one more effect, grown from the best set.

        looked: effects whose directions are taken anew; fitted: sets that are fitted.
        """
        parent = found.tested[-1][0]
        best = parent.explanation
        likelihood, lin, singles = self.predicted_beside(found, best, looked)
        tests = found.tests.beside(likelihood, lin)
        more = self.fits.fitted(likelihood, best, singles[:fitted])
        if more and taken_up(likelihood, best, more[0]).share >= PROMISING:
            more = self.fits.exchanged(likelihood, more, found.explanations[1 : 1 + EXCHANGED])
        likelihood = likelihood.scaled_to(more[0].residual) if more else likelihood
        found = replace(found, likelihood=likelihood, tests=tests)
        return found.with_round(tested(likelihood, tests, more), parent)

    def predicted_beside(
        self, found: Isolation, e: Explanation, looked: int = RENEWED
    ) -> tuple[Likelihood, Linearisation, list[Predicted]]:
        """Views in units of what an explanation leaves, directions beside it, and each further effect, best first."""
        likelihood = found.likelihood.scaled_to(e.residual).for_stage("linearise again")
        lin = self.linearised(likelihood, e, found.tests.lin, looked)
        likelihood = likelihood.for_stage("refine again")
        return likelihood, lin, NormalMatrix(likelihood, e, lin).singles()

    def linearised(
        self, likelihood: Likelihood, e: Explanation, known: Linearisation, count: int = RENEWED
    ) -> Linearisation:
        """Directions of all other effects beside an explanation, anew for so many where known ones promise most.

        Its nominal Jacobian is kept, and so are directions that were taken beside it before.
        """
        promising = [p.probes[0].effect for p in NormalMatrix(likelihood, e, known).singles()][:count]
        lin, taken = self.beside.get(e, (known, frozenset()))
        effects, n = [effect for effect in self.effects if effect.id in set(promising) - taken], e.nominal
        if effects:
            new = linearise(likelihood, e.at_nominal, e.x[:n], e.parameters[:n], effects, e.jacobian, e.residual)
            lin = renewed(lin, new)
        self.beside[e] = lin, taken.union(promising)
        return lin
