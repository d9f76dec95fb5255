"""Fits of explanations with one more effect: where they start, which go on, and which get a new nominal Jacobian."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from exodrake.core.machine import Machine
from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.core.threads import side_by_side
from exodrake.diagnosis.comparison import taken_up
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.linearise import nominal_jacobian, with_effects
from exodrake.diagnosis.one_more import PROMISING
from exodrake.diagnosis.refine import STEPS, TOL, Explanation, minimise
from exodrake.diagnosis.select import Predicted
from exodrake.diagnosis.stuck import from_another_law, searched

FIRST_STEPS = 2  # of all fits; those that are not far behind go on
BEHIND, NEAR = 1.5, 0.4  # mean logarithm of chi-squares: far behind after first steps; as good as the best
CONVERGED = 0.1  # the same above noise: a fit that leaves less has a new Jacobian only if it is the best in the end
FRESH = 2  # fits with a new nominal Jacobian, beside that of the effect that was predicted best
ROUNDS, USELESS = 3, 1.0  # new nominal Jacobians at most; logarithm of a likelihood (Akaike 1974)
LESS, INITIAL = (1.0, 0.5, 0.2), (1.0, 0.3)  # of the predicted and of the initial amplitude, tried where a fit begins


class Fits:
    """Fits on one case.

    Args:
        machine: of the robots.
        progress: called with the stage and the name of what is fitted.
    """

    def __init__(self, machine: Machine, progress: StageProgress = no_progress) -> None:
        self.machine, self.progress = machine, progress

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
        return e if likelihood.mean_log(e.residual) <= CONVERGED else self.refreshed(closer, e)

    def settled(self, likelihood: Likelihood, e: Explanation) -> Explanation:
        """The explanation fitted on with new nominal Jacobians, until one gains less than a parameter of no use may."""
        for _ in range(ROUNDS):
            before, e = e.cost(likelihood), self.refreshed(likelihood, e)
            if before - e.cost(likelihood) < USELESS:
                break
        return e

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
