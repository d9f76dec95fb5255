"""State of an isolation: the explanations that were tried, by number of effects, and those that the logs leave."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np

from exodrake.core.threads import side_by_side
from exodrake.diagnosis.comparison import richer_law, taken_up
from exodrake.diagnosis.intervals import Fitted
from exodrake.diagnosis.levels import Levels, Tests
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.linearise import Linearisation
from exodrake.diagnosis.refine import Explanation
from exodrake.diagnosis.select import Predicted


@dataclass(frozen=True, eq=False)
class Tested:
    """An explanation with its levels, its reduced chi-squares (views,) and its cost."""

    explanation: Explanation
    levels: Levels
    chi2: np.ndarray
    cost: float


def needless(likelihood: Likelihood, richer: Tested, simpler: Tested) -> bool:
    """Whether an explanation is another law of a simpler one, with more parameters to no avail."""
    name = richer.explanation.name
    return name in simpler.levels.no_better and richer_law(likelihood, richer.explanation, simpler.explanation)


def tested(
    likelihood: Likelihood, tests: Tests, found: Sequence[Explanation], larger: Sequence[Explanation] = ()
) -> list[Tested]:
    """Explanations of one size with their levels, best first; larger: fitted ones of the next size.

    The noise of all is known before one is compared with another.
    """
    side_by_side([partial(tests.measure_noise, e) for e in found])
    rivals = [[*(other for other in found if other is not e), *larger] for e in found]
    levels = side_by_side([partial(tests, *each) for each in zip(found, rivals, strict=True)])
    made = [Tested(e, own, likelihood.chi2(e.residual), e.cost(likelihood)) for e, own in zip(found, levels)]
    return sorted(made, key=lambda t: t.cost)


@dataclass(frozen=True, eq=False)
class Isolation:
    """Explanations tried so far, by number of effects, with their tests.

    Attributes:
        likelihood: views of the case.
        tests: tests of the last round.
        nominal, retuned: robots without an effect.
        beside_retuned: directions of all effects beside the retuned robot.
        screened: each effect alone as the linearisation predicts it, best first.
        tested: tested explanations of 1, 2, ... effects, best first.
        left: explanations of the smallest size that the logs do not reject, best first; none for an unknown cause.
        irreducible: those of them none of whose effects could be taken out: the logs reject the fit of the rest.
    """

    likelihood: Likelihood
    tests: Tests
    nominal: Tested
    retuned: Tested
    beside_retuned: Linearisation
    screened: tuple[Predicted, ...] = ()
    tested: tuple[tuple[Tested, ...], ...] = ()
    left: tuple[Tested, ...] = ()
    irreducible: tuple[Tested, ...] = ()

    def with_round(self, tested: Sequence[Tested], parent: Tested | None = None) -> Isolation:
        """The isolation with the explanations of one size more.

        Of a parent that leaves too much, each must take up most: else it is kept for the error of one law more alone.
        """
        kept = [t for t in tested if t.levels.kept]
        if parent is not None and not parent.levels.consistent:
            kept = [t for t in kept if self.share(parent.explanation, t.explanation) > self.tests.calibration.taken]
        left = tuple(t for t in kept if not any(needless(self.likelihood, t, other) for other in kept))
        return replace(self, tested=(*self.tested, tuple(tested)), left=left)

    def share(self, e: Explanation, larger: Explanation) -> float:
        """Share of what an explanation leaves that a larger one takes up, above the noise of both."""
        return taken_up(self.likelihood, e, larger, self.tests.noise.levels(self.likelihood, e, larger)).share

    def without_effects(self) -> Isolation:
        """The isolation that stops at the robot without an effect, if it is kept."""
        return replace(self, left=tuple(t for t in (self.nominal, self.retuned) if t.levels.kept)[:1])

    @property
    def sufficient(self) -> bool:
        """Whether some explanations of the last size are left, and none lacks an effect other than the best one's."""
        if not self.left:
            return False
        best = self.left[0]
        others = (t for t in self.left if t.levels.next_effect not in best.explanation.effects)
        return best.levels.sufficient and all(t.levels.sufficient for t in others)

    @cached_property
    def fitted(self) -> Callable[[Tested], Fitted]:
        """Parameters of the effects of an explanation with their covariance, computed once each."""

        def found(t: Tested) -> Fitted:
            e = t.explanation
            return Fitted(e.parameters[e.nominal :], e.x[e.nominal :], self.tests.covariance(e))

        return cache(found)

    @property
    def explanations(self) -> list[Explanation]:
        """The explanations of the last size."""
        return [t.explanation for t in self.tested[-1]]

    @property
    def best(self) -> Tested:
        """The explanation of least cost, whether the logs reject it or not."""
        tried = (self.retuned, *(t for size in self.tested for t in size))
        return min(tried, key=lambda t: t.explanation.cost(self.likelihood))
