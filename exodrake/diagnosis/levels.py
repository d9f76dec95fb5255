"""Levels: p-values of an explanation's residual under noise and errors of its laws.

The law of an effect in the model is not the robot's. Its error is a random smooth function h of the measured state
times c, the part of the effect's contribution that no other parameter imitates (model discrepancy; Kennedy & O'Hagan
2001, Brynjarsdottir & O'Hagan 2014):

    r = w + a c(t) h(state(t))            w noise, h of zero mean and unit variance, a <= rho

Draws of it, with matrix products, give p-values of an explanation; only the noise of a loop that hunts is simulated
(`hunting`):

    fit         may so much be left?                                 draws with a = rho
    complete    may one more effect take up so much of it?           draws with the a of another simulator of one law

An explanation whose nominal parameters have to move further than their tolerances allow is rejected, too: wrong effects
lean on them.

A rival is another fitted explanation that moves them no further. It beats the explanation if its reduction of the cost
exceeds that of an effect under noise and the difference of two simulators, and its share of the excess over noise that
under an error of the law. Where no joint moves another (`Machine.separate`) joints that leave too much are compared
alone, too: a sum over all joints hides a cause in one joint behind the errors of the others' laws.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from exodrake.core.confidence import ALPHA
from exodrake.diagnosis.calibration import calibration_of, spread
from exodrake.diagnosis.comparison import (
    Compared,
    amplitude,
    excess,
    power,
    richer_law,
    share_of,
    taken_up,
)
from exodrake.diagnosis.discrepancy import TYPICAL, LawErrors
from exodrake.diagnosis.hunting import REJECTED, Noise
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.linearise import Linearisation
from exodrake.diagnosis.one_more import PROMISING, OneMore
from exodrake.diagnosis.p_values import ViewNull, exceeding
from exodrake.diagnosis.projection import Projection
from exodrake.diagnosis.refine import Explanation
from exodrake.diagnosis.scan import local_levels, scan
from exodrake.diagnosis.tolerances import least_use, most_use, tolerance_use

LOCAL = 1e-6  # of the scan: the largest of a thousand windows, whose tail 99 draws tell roughly
DRAWS = 99


@dataclass(frozen=True)
class Levels:
    """p-values of an explanation.

    Attributes:
        fit: of what it leaves, tested jointly with `views`, so that the smallest has its level.
        views: the same for each view alone.
        hunting: reduced chi-square that noise alone leaves in closed loop, where it makes the loop hunt; 1 elsewhere.
        local: of what it leaves in single windows of time; 1 for one with effects.
        complete: of what one more effect takes up, by the linearisation; `next_effect` is that effect.
        promise: share of the excess over noise that it takes up.
        beaten_by: name of an explanation that was fitted and beats it; empty if none does.
        no_better: names of those that take up no more than noise and another simulator let them.
        share: share of the excess that the best other explanation takes up.
        law_error: error of the laws that explains what is left, in units of rho.
        moved: mean square of the nominal parameters' changes in standard deviations of their tolerances; about 1 or
            less for a robot of these tolerances. With effects the least that noise and the errors of their laws need.
        most_moved: largest plausible one.
    """

    fit: float
    views: tuple[float, ...]
    hunting: float
    local: float
    complete: float
    promise: float
    next_effect: str
    beaten_by: str
    no_better: tuple[str, ...]
    share: float
    law_error: float
    moved: float
    most_moved: float

    @property
    def kept(self) -> bool:
        """Whether the tests so far do not reject the explanation."""
        return self.consistent and self.moved <= self.most_moved and not self.beaten_by

    @property
    def consistent(self) -> bool:
        """Whether it leaves no more than it may, in every view."""
        return self.local > LOCAL and min(self.fit, *self.views) > ALPHA

    @property
    def burst(self) -> bool:
        """Whether single windows of time alone speak against it, which no effect of the whole motion explains."""
        return self.local <= LOCAL and min(self.fit, *self.views) > ALPHA and self.moved <= self.most_moved

    @property
    def sufficient(self) -> bool:
        """Whether it is kept and no further effect is promising."""
        return self.kept and (self.complete > PROMISING or self.promise < PROMISING)


class Null(NamedTuple):
    """What an explanation may leave: draws of its noise and of errors of its laws (`LawErrors`).

    Attributes:
        project: in units of what it leaves.
        noise, law, model: (draws, samples) of noise, of the laws at rho, and of the difference between simulators.
    """

    project: Projection
    noise: np.ndarray
    law: np.ndarray
    model: np.ndarray


class Tests:
    """Tests of explanations on one case.

    Args:
        likelihood: views of the case.
        lin: directions of the effects that may be added.
        moved: (samples,) change of the residual from the nominal to the retuned robot.
    """

    def __init__(self, likelihood: Likelihood, lin: Linearisation, moved: np.ndarray) -> None:
        self.likelihood, self.lin = likelihood, lin
        self.calibration = calibration_of(likelihood.robot.machine)
        self.noise = Noise(likelihood, DRAWS)
        self.laws = LawErrors(likelihood, moved, DRAWS, self.calibration)
        self.joints = likelihood.samples_of_joints() if likelihood.robot.machine.separate else []

    def beside(self, likelihood: Likelihood, lin: Linearisation) -> Tests:
        """The tests with other directions and units, and the same draws."""
        found = copy(self)
        found.likelihood, found.lin = likelihood, lin
        return found

    def __call__(self, e: Explanation, rivals: Sequence[Explanation] = ()) -> Levels:
        """The levels of an explanation; rivals: others that were fitted."""
        project, noise, law, model = self.null(e)
        likelihood = project.likelihood
        left, noise_left, law_left = (project.left(rows) for rows in (e.residual[None], noise, law))
        needed = amplitude(left[0], noise_left, law_left)
        null = ViewNull.of(likelihood, noise, law)
        *views, fit = null.p_values(e.residual, (noise_left + law_left, float(left[0])))
        local = [1.0]
        if not e.effects:
            local = local_levels(scan(likelihood, noise + law), scan(likelihood, e.residual[None]))
        true_law = min(fit, *views) > ALPHA and float(np.median(needed)) <= 1.0
        parts = [self.compared(project, model, rivals, max(fit, *views) < REJECTED, true_law)]
        for at in self.joints:
            p = exceeding(power(noise[:, at]) + power(law[:, at]), float(power(e.residual[at])))
            if len(self.joints) * p < ALPHA:  # at the level of all joints (Bonferroni)
                alone = likelihood.of_samples(at)
                parts.append(self.compared(Projection(alone, e, self.lin), model, rivals, p < REJECTED, False))
        most = max(parts, key=lambda part: part.promise)
        return Levels(
            fit=fit,
            views=tuple(views),
            hunting=float(self.noise.levels(likelihood, e)[0]),
            local=min(1.0, len(local) * min(local)),
            complete=most.complete,
            promise=most.promise,
            next_effect=most.next_effect,
            beaten_by=next((part.beaten_by for part in parts if part.beaten_by), ""),
            no_better=tuple(r.name for r in rivals if all(r.name in part.no_better for part in parts)),
            share=max(part.share for part in parts),
            law_error=float(np.median(needed)),
            moved=least_use(project, lambda residual: min(null.p_values(residual)) > ALPHA),
            most_moved=most_use(project, self.calibration, self.noise.retuned),
        )

    def compared(
        self, project: Projection, model: np.ndarray, rivals: Sequence[Explanation], rejected: bool, true_law: bool
    ) -> Compared:
        """An explanation against rivals that were fitted, and against one more effect by the linearisation.

        Args:
            project: of the whole case or of a joint.
            model: (draws, samples) difference between simulators.
            rivals: that were fitted.
            rejected: whether it leaves so much that no draw tells.
            true_law: whether its laws may be true.
        """
        e, likelihood, beaten_by = project.explanation, project.likelihood, ""
        further = OneMore(project, None if rejected else self.noise.of(e) + model)
        next_one, levels = further.most(e.residual), self.noise.levels(likelihood, e)
        share, no_better, moved = 0.0, [], max(tolerance_use(e), self.calibration.moved)
        for rival in (r for r in rivals if tolerance_use(r) <= max(moved, spread(r.nominal))):
            taken = taken_up(likelihood, e, rival, self.noise.levels(likelihood, e, rival))
            share = max(share, taken.share)
            if further.p_value(set(rival.effects) - set(e.effects), taken.power) >= ALPHA:
                no_better.append(rival.name)
            elif taken.share > self.calibration.taken and not (true_law and richer_law(self.likelihood, rival, e)):
                beaten_by = rival.name
        promise = share_of(next_one.power, excess(likelihood, e, levels))
        return Compared(next_one.p, promise, next_one.effect, beaten_by, frozenset(no_better), share)

    def measure_noise(self, e: Explanation) -> None:
        """Simulate the noise of an explanation's own robot where it is needed: before it is a rival of others."""
        if not self.noise.known(self.likelihood, e):
            self.null(e)

    def null(self, e: Explanation) -> Null:
        """What an explanation may leave; noise of its own is simulated once."""
        project = Projection(self.likelihood.scaled_to(e.residual), e, self.lin)
        law, model = self.laws(project)
        return Null(project, self.noise.measured(project, law), law, model)

    def covariance(self, e: Explanation) -> np.ndarray:
        """Covariance of the effects' coordinates (k, k), from noise and from errors of the laws.

        These are as large as what is left shows, and `TYPICAL` at least: noise and other parameters hide smaller ones.
        """
        project, noise, law, _ = self.null(e)
        needed = amplitude(*(project.left(rows) for rows in (e.residual[None], noise, law)))
        errors = np.maximum(needed, np.float32(TYPICAL))[:, None] * law
        moves = project.moves(noise + errors, np.random.default_rng(2))
        return np.atleast_2d(np.cov(moves[e.nominal :]))
