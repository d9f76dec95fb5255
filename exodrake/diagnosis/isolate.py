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
from functools import partial

import numpy as np

from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.core.threads import side_by_side
from exodrake.diagnosis.comparison import taken_up
from exodrake.diagnosis.isolation import Isolation, tested
from exodrake.diagnosis.levels import PROMISING, Tests
from exodrake.diagnosis.likelihood import Likelihood, likelihood_of
from exodrake.diagnosis.linearise import Linearisation, linearise, nominal_jacobian, renewed, with_effects
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.prune import spurious
from exodrake.diagnosis.refine import STEPS, TOL, Explanation, astray, minimise
from exodrake.diagnosis.select import NormalMatrix, Predicted
from exodrake.diagnosis.stuck import from_another_law, searched

REFINED = 5  # sets of effects of one size that are fitted
EXCHANGED = 2  # other sets than the best one beside which an effect is tried that was found beside the best
FIRST_STEPS = 2  # of all fits; those that are not far behind go on
BEHIND, NEAR = 1.5, 0.4  # mean logarithm of chi-squares: far behind after first steps; as good as the best
CONVERGED = 0.1  # the same above noise: a fit that leaves less needs no new Jacobian, if it is not astray
RENEWED = 24  # effects whose directions are taken anew beside an explanation, the most promising by the known ones
FRESH = 2  # fits with a new nominal Jacobian, beside that of the effect that was predicted best
LESS, INITIAL = (1.0, 0.5, 0.2), (1.0, 0.3)  # of the predicted and of the initial amplitude, tried where a fit begins


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
        self.machine, self.simulated = problem.robot.machine, simulated
        self.effects = [effect for effect in self.machine.effects if effect.id in problem.tried]

    def isolate(self, max_effects: int) -> Isolation:
        """Explanations of growing size until some are left."""
        start = self.start
        likelihood = likelihood_of(self.problem, start.robot, self.simulated).for_stage("linearise")
        self.progress(Stage.LINEARISE, "")
        lin = linearise(likelihood, start.values, start.x, start.parameters, self.effects)
        start = replace(start, residual=lin.residual, jacobian=lin.jacobian)
        likelihood = likelihood.scaled_to(lin.residual).for_stage("refine")
        retuned = self.refined(likelihood, start, STEPS)
        zero = start.at(likelihood, np.zeros(len(start.x)))
        tests = Tests(likelihood, lin, zero.residual - retuned.residual)
        nominal, best = (tested(likelihood, tests, [e])[0] for e in (zero, retuned))
        found = Isolation(likelihood, tests, nominal, best, lin)
        if found.nominal.levels.sufficient or found.retuned.levels.sufficient or not max_effects or not self.effects:
            return found.without_effects()
        screened = NormalMatrix(likelihood, retuned, lin).singles()
        singles = self.singles(found, screened)
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
        while not found.sufficient and len(found.tested) < max_effects:
            larger = self.grown(found)
            if not larger.explanations:
                return found
            again = tested(found.likelihood, found.tests, found.explanations, larger.explanations)
            parent = next(t for t in again if t.explanation is found.tested[-1][0].explanation)
            if found.left and not (parent.levels.beaten_by and self.needed(larger)):
                return found
            if any(t.levels.kept for t in again):
                return replace(found, tested=found.tested[:-1]).with_round(again)
            found = larger
        return found

    def needed(self, larger: Isolation) -> bool:
        """Whether some set of the last size has no effect that may as well be absent, or none is kept."""
        counted = self.problem.counted
        return not larger.left or not all(spurious(t, larger.fitted(t), counted) for t in larger.left)

    def singles(self, found: Isolation, screened: Sequence[Predicted]) -> list[Explanation]:
        """The most promising single effects, fitted, and what would be added to the best of them."""
        likelihood, known = found.likelihood, found.retuned.explanation
        fitted = self.fitted(likelihood, known, screened[:REFINED])
        levels = found.tests(fitted[0])
        further = [p for p in screened[REFINED:] if p.probes[0].effect == levels.next_effect and not levels.sufficient]
        more = [*fitted, *self.fitted(likelihood, known, further, likelihood.mean_log(fitted[0].residual))]
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
        more = [*found.explanations, *self.fitted(likelihood, zero, screened[:REFINED])]
        best = {e.name: e for e in sorted(more, key=lambda e: -e.cost(likelihood))}
        return replace(found, tested=()).with_round(tested(likelihood, found.tests, list(best.values())))

    def grown(self, found: Isolation) -> Isolation:
        """The isolation with sets of one more effect, grown from the best set."""
        parent = found.tested[-1][0]
        best = parent.explanation
        likelihood = found.likelihood.scaled_to(best.residual).for_stage("linearise again")
        lin = self.linearised(likelihood, best, found.tests.lin)
        likelihood = likelihood.for_stage("refine again")
        tests = found.tests.beside(likelihood, lin)
        more = self.fitted(likelihood, best, NormalMatrix(likelihood, best, lin).singles()[:REFINED])
        if more and taken_up(likelihood, best, more[0]).share >= PROMISING:
            more = self.exchanged(likelihood, more, found.explanations[1 : 1 + EXCHANGED])
        likelihood = likelihood.scaled_to(more[0].residual) if more else likelihood
        found = replace(found, likelihood=likelihood, tests=tests)
        return found.with_round(tested(likelihood, tests, more), parent)

    def fitted(
        self, likelihood: Likelihood, known: Explanation, found: Sequence[Predicted], least: float = np.inf
    ) -> list[Explanation]:
        """Further effects beside those of an explanation, fitted, best first; those far behind not to the end.

        least: mean logarithm of chi-squares that others leave.
        """
        first = side_by_side([partial(self.first_steps, likelihood, known, p) for p in found])
        cost = [likelihood.mean_log(e.residual) for e in first]
        near = [c < min(*cost, least) + BEHIND for c in cost]
        scaled = [likelihood.scaled_to(e.residual) for e in first]
        further = side_by_side([partial(self.refined, s, e, STEPS) for s, e, ok in zip(scaled, first, near) if ok])
        done = [*further, *(e for e, ok in zip(first, near, strict=True) if not ok)]
        done.sort(key=lambda e: likelihood.mean_log(e.residual))
        closer = likelihood.scaled_to(done[0].residual) if done else likelihood
        for k, e in enumerate(done):
            promised = k >= FRESH and e.effects[-1] == found[0].probes[0].effect
            if k < FRESH or promised:
                least = min(least, likelihood.mean_log(done[0].residual))
                if likelihood.mean_log(e.residual) < least + NEAR:
                    done[k] = self.continued(likelihood, closer, known, e, promised)
                if done[k].rough and likelihood.mean_log(e.residual) > CONVERGED:
                    done[k] = searched(likelihood.scaled_to(done[k].residual), done[k])
        done = side_by_side([partial(from_another_law, likelihood, e, done, BEHIND) for e in done])
        return sorted(done, key=lambda e: likelihood.mean_log(e.residual))

    def exchanged(
        self, likelihood: Likelihood, found: list[Explanation], others: Sequence[Explanation]
    ) -> list[Explanation]:
        """Sets of effects, best first, and the last effect of the best one beside other sets than its own.

        The best single effect may stand for one of two, which shows only beside the other one.
        """
        effect = found[0].effects[-1]
        own = [i for i, p in enumerate(found[0].parameters) if p.effect == effect]
        more = list(found)
        for e in (e for e in others if effect not in e.effects):
            values = with_effects(e.values, [(self.machine, self.machine.effect(effect))])
            parameters = e.parameters + tuple(found[0].parameters[i] for i in own)
            joined = Explanation((*e.effects, effect), parameters, e.x, values, e.residual, e.jacobian)
            more.append(self.refined(likelihood, joined.at(likelihood, np.r_[e.x, found[0].x[own]]), STEPS))
        return sorted(more, key=lambda e: likelihood.mean_log(e.residual))

    def continued(
        self, likelihood: Likelihood, closer: Likelihood, known: Explanation, e: Explanation, promised: bool
    ) -> Explanation:
        """A fit that is as good as the best, fitted on with a new nominal Jacobian if it may gain.

        Args:
            likelihood: views of the case.
            closer: the same in units of what the best fit leaves.
            known: explanation beside which its last effect was added.
            e: the fit.
            promised: whether its last effect was predicted best and takes up less: it is far from its minimum, so that
                the Jacobian is renewed twice.
        """
        if promised:
            return self.refreshed(closer, self.refreshed(closer, e))
        if taken_up(likelihood, known, e).share <= PROMISING:
            return e
        converged = likelihood.mean_log(e.residual) <= CONVERGED
        return e if converged and not astray(closer, e) else self.refreshed(closer, e)

    def refreshed(self, likelihood: Likelihood, e: Explanation) -> Explanation:
        """The explanation fitted on with a new nominal Jacobian."""
        count = e.nominal
        jacobian = nominal_jacobian(likelihood, e.at_nominal, e.parameters[:count], e.x[:count], e.residual)
        return self.refined(likelihood, e.with_jacobian(jacobian), STEPS)

    def refined(self, likelihood: Likelihood, start: Explanation, steps: int) -> Explanation:
        """The explanation fitted."""
        self.progress(Stage.FIT, start.name)
        return minimise(likelihood, start, steps, TOL)

    def first_steps(self, likelihood: Likelihood, known: Explanation, predicted: Predicted) -> Explanation:
        """The better of two fits after their first steps: from the prediction, and from the start of least cost."""
        starts = self.starts(likelihood, known, predicted)
        least = min(starts, key=lambda e: e.cost(likelihood))
        found = [self.refined(likelihood, e, FIRST_STEPS) for e in {id(e): e for e in (starts[0], least)}.values()]
        return min(found, key=lambda e: e.cost(likelihood))

    def starts(self, likelihood: Likelihood, known: Explanation, predicted: Predicted) -> list[Explanation]:
        """Explanations with one more effect: as the linearisation predicts it, less of it, at initial amplitudes."""
        (probe,), (factors,) = predicted.probes, predicted.factors
        values = with_effects(known.values, [(self.machine, self.machine.effect(probe.effect))])
        parameters, own = known.parameters + probe.parameters, probe.coordinates(factors)
        amplitude = np.array([p.amplitude for p in probe.parameters])
        low, high = np.array([p.bounds for p in parameters]).T
        joined = Explanation((*known.effects, probe.effect), parameters, own, values, known.residual, known.jacobian)
        initial = np.array([p.start for p in probe.parameters])
        starts = [np.concatenate([predicted.x, np.where(amplitude, less * own, own)]) for less in LESS]
        starts += [np.concatenate([known.x, np.where(amplitude, share * initial, initial)]) for share in INITIAL]
        return joined.at_each(likelihood, list(np.clip(starts, low, high)))

    def linearised(self, likelihood: Likelihood, e: Explanation, known: Linearisation) -> Linearisation:
        """Directions of all other effects beside an explanation, anew where known ones promise most.

        Its nominal Jacobian is kept.
        """
        promising = [p.probes[0].effect for p in NormalMatrix(likelihood, e, known).singles()][:RENEWED]
        effects, count = [effect for effect in self.effects if effect.id in promising], e.nominal
        lin = linearise(likelihood, e.at_nominal, e.x[:count], e.parameters[:count], effects, e.jacobian, e.residual)
        return renewed(known, lin)
