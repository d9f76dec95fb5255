"""Search for what explains a case: retune, screen every effect of the effect library, fit the promising ones, then
pairs by forward search.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.diagnosis.fit import Fitter, Point
from exodrake.diagnosis.hypothesis import NOTHING, Hypothesis, hypothesis
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.retune import CLOSE, Retuned, multi_started, retuned
from exodrake.diagnosis.screen import Start, screened


@dataclass(frozen=True, eq=False)
class Fitted:
    """A hypothesis after its fit: the point, and its residual on held-out logs."""

    point: Point
    held: np.ndarray

    @property
    def name(self) -> str:
        """Ids joined by +; `retune` for no effect."""
        return self.point.hypothesis.name or "retune"

    @property
    def chi2(self) -> float:
        """Mean square residual on the fitted logs [noise variance]."""
        return self.point.chi2

    @property
    def holdout_chi2(self) -> float:
        """Mean square residual on held-out logs [noise variance]."""
        return float(np.mean(self.held**2))

    @property
    def score(self) -> float:
        """Cost on all logs: what candidates are ranked by."""
        return self.point.cost + 0.5 * float(self.held @ self.held)


@dataclass(frozen=True, eq=False)
class Search:
    """What was tried, best first, with the nominal and the retuned robot beside it.

    lossy: commands were seen to be lost, though that does not close the gap: what was lost unseen cannot be repeated.
    """

    nominal: Fitted
    retuned: Fitted
    singles: tuple[Fitted, ...] = ()
    pairs: tuple[Fitted, ...] = ()
    screened: tuple[tuple[str, float], ...] = field(default=())
    losses_evident: bool = False


PACKET_LOSS = "timing.dropped_commands"
SHARE = 0.6  # of each trial: what screening and racing see
SHORTLIST, FINALISTS, REFINED = 12, 3, 2  # effects raced; fitted to the end; refined on whole trials
FEW = 4, 2, 1  # the same where retuned numbers explain a case: what could be there is small, and screening it linear
SECOND_SHORTLIST, SECOND_FINALISTS, SECOND_REFINED = 6, 3, 2  # the same for second effects
CONTENDS = 1.5  # a candidate whose reduced chi-square is within this factor of the best one's is refined, too
FLOORED = 1.02  # reduced chi-square at which a fit has converged, if its nominal parameters are not strained
STRAINED = 1.0  # mean square of the nominal numbers in units of their spread, beyond which they hide something
LESS = 1.0, 0.5, 0.2, 0.05  # of an effect's promised amount, tried where its fit begins
EARLY_STOP = 4.0  # a candidate whose reduced chi-square is this many times the best one's after two steps is dropped


class Ranking:
    """The course of a search: what is fitted, refined and paired."""

    def __init__(
        self, problem: Problem, progress: StageProgress = no_progress, start: np.ndarray | None = None
    ) -> None:
        self.full, self.quick = Fitter(problem), Fitter(problem.shortened(SHARE))
        self.progress = progress
        self.origin = self.full.at(NOTHING, np.zeros(0), np.zeros(len(self.full.coordinates)))
        self.begin = self.origin if start is None else self.full.at(NOTHING, np.zeros(0), start)
        self.own: dict[str, np.ndarray] = {}
        self.still: set[Point] = set()

    def complete(self, point: Point) -> Fitted:
        """A fitted point with its residual on held-out logs."""
        values = self.full.values(point.hypothesis, point.u, point.x)
        return Fitted(point, self.full.problem.residual(values[None], self.full.problem.holdout)[0])

    def nominal(self) -> Fitted:
        """The nominal robot."""
        return self.complete(self.origin)

    @cached_property
    def tuned(self) -> Retuned:
        """The course of retuning."""
        self.progress(Stage.RETUNE, "")
        return retuned(self.full, self.begin)

    def retuned(self) -> Fitted:
        """The robot with its nominal numbers fitted."""
        return self.complete(self.tuned.point)

    def tuned_to_all(self) -> Fitted:
        """The robot with its nominal numbers fitted to held-out logs, too: only these may meet some end stop."""
        problem = self.full.problem
        every = Fitter(replace(problem, fit=(*problem.fit, *problem.holdout)))
        start = every.at(NOTHING, np.zeros(0), self.tuned.point.x)
        responses = every.responses(start)
        found = every.fit(multi_started(every, start, responses), responses, steps=8)
        return self.complete(self.full.at(NOTHING, np.zeros(0), found.x))

    def singles(self, consistent: bool = False) -> tuple[list[Fitted], list[tuple[str, float]]]:
        """The shortlist raced, fitted and refined, best first; and the screening reduced chi-square of all effects.
        quiet: see `FEW`.
        """
        tuned = self.tuned
        self.progress(Stage.SCREEN, "")
        kept, base = self.kept_rows(tuned.responses), self.quick.at(NOTHING, np.zeros(0), tuned.base.x)
        gram = kept.T @ kept
        starts = screened(self.quick, base, kept, gram)
        shortlist, finalists, refined = FEW if consistent else (SHORTLIST, FINALISTS, REFINED)
        found = self.race(starts[:shortlist], kept, gram, finalists)
        best = self.refine(found, refined, tuned.responses)
        return best, [(start.hypothesis.name, 2.0 * start.cost / len(base.residual)) for start in starts]

    def second_alone(self, pair: Fitted) -> Fitted:
        """The second effect of a pair fitted without the first, which may only have stood in for it when singles were
        screened.
        """
        alone, u = self.second_of(pair)
        self.progress(Stage.FIT, alone.name)
        start = self.full.at(alone, u, pair.point.x)
        return self.complete(self.full.fit(start, self.tuned.responses, steps=8))

    def second_beside(self, pair: Fitted, other: Fitted) -> Fitted:
        """The second effect of a pair beside another first one."""
        alone, u = self.second_of(pair)
        both = other.point.hypothesis.joined(alone)
        self.progress(Stage.FIT, both.name)
        start = self.full.at(both, np.concatenate([other.point.u, u]), pair.point.x)
        responses = self.own.get(pair.name, self.tuned.responses)
        return self.complete(self.full.fit(start, responses, steps=8))

    def second_of(self, pair: Fitted) -> tuple[Hypothesis, np.ndarray]:
        """The second effect of a pair, and its u."""
        machine, both = self.full.problem.robot.machine, pair.point.hypothesis
        alone = hypothesis(machine, machine.effect(both.effects[-1]))
        return alone, pair.point.u[[both.coordinates.index(coordinate) for coordinate in alone.coordinates]]

    def packet_loss(self, singles: list[Fitted]) -> Fitted:
        """The fit of lost commands alone."""
        known = next((f for f in singles if f.name == PACKET_LOSS), None)
        return known or self.packet_loss_beside(self.retuned())

    def packet_loss_beside(self, fitted: Fitted) -> Fitted:
        """A fitted hypothesis with lost commands beside it."""
        point, machine = fitted.point, self.full.problem.robot.machine
        lost = hypothesis(machine, machine.effect(PACKET_LOSS))
        both = point.hypothesis.joined(lost)
        self.progress(Stage.FIT, both.name)
        start = self.full.at(both, np.concatenate([point.u, lost.start]), point.x)
        return self.complete(self.full.fit(start, self.own.get(fitted.name, self.tuned.responses), steps=4))

    def converged(self, fitted: Fitted) -> Fitted:
        """A hypothesis minimised (`Fitter.minimised`), as its parameters are to be stated."""
        return fitted if fitted.point in self.still else self.complete(self.minimised(fitted.point, central=True))

    def minimised(self, point: Point, central: bool) -> Point:
        """A point fitted until its cost stands still; its responses are kept."""
        name = point.hypothesis.name
        self.progress(Stage.REFINE, name)
        point, self.own[name] = self.full.minimised(point, central)
        self.still |= {point} if central else set()
        return point

    def kept_rows(self, responses: np.ndarray) -> np.ndarray:
        """Rows of whole-trial responses that belong to the shortened trials."""
        columns, parts, at = len(self.full.problem.columns), [], 0
        for whole, part in zip(self.full.problem.fit, self.quick.problem.fit, strict=True):
            parts.append(responses[at : at + columns * len(part.reference)])
            at += columns * len(whole.reference)
        return np.concatenate(parts)

    def race(self, starts: list[Start], responses: np.ndarray, gram: np.ndarray, finalists: int) -> list[Point]:
        """Points after two steps each, the hopeless dropped and the survivors fitted to the end, the most promising of
        the starts in any case; best first.
        """
        fitter, points = self.quick, []
        for start in starts:
            self.progress(Stage.FIT, start.hypothesis.name)
            points.append(fitter.fit(self.started(start), responses, steps=2, gram=gram))
        promising, ranked = points[:1], sorted(points, key=lambda p: p.cost)
        hopeful = [p for p in ranked[:finalists] if p.chi2 < EARLY_STOP * ranked[0].chi2]
        hopeful += [p for p in promising if p not in hopeful]
        ended = [fitter.fit(p, responses, steps=6, gram=gram) for p in hopeful]
        return sorted([*ended, *(p for p in ranked if p not in hopeful)], key=lambda p: p.cost)

    def started(self, start: Start) -> Point:
        """Where a fit begins: what screening promises, or less of the effect where that breaks the promise."""
        fitter, latest = self.quick, start.hypothesis.effects[-1]
        first = np.array(
            [coordinate.first and coordinate.effect == latest for coordinate in start.hypothesis.coordinates]
        )
        x = np.clip(start.x, -fitter.limit, fitter.limit)
        tried: list[Point] = []
        for less in LESS:
            u = np.clip(np.where(first, less * start.u, start.u), *start.hypothesis.bounds.T)
            tried.append(fitter.at(start.hypothesis, u, x))
            if tried[-1].cost < EARLY_STOP * start.cost:
                break
        return min(tried, key=lambda point: point.cost)

    def refine(self, points: list[Point], count: int, responses: np.ndarray) -> list[Fitted]:
        """The best few fitted on whole trials, contenders among them minimised, the rest as they are; best first.

        responses: of a point nearby (samples, nominal coordinates).
        """
        fitter, found = self.full, []
        for k, p in enumerate(points):
            start = fitter.at(p.hypothesis, p.u, p.x)
            if k < count:
                self.progress(Stage.REFINE, p.hypothesis.name)
                start = fitter.fit(start, responses, steps=8)
            found.append(start)
        found.sort(key=lambda p: p.cost)
        for k, p in enumerate(found[:count]):
            ended = p.chi2 <= FLOORED and fitter.nuisance_chi2(p) <= STRAINED
            if not ended and (k == 0 or p.chi2 < CONTENDS * found[0].chi2):
                found[k] = self.minimised(p, central=p.chi2 < CLOSE)
        return sorted(map(self.complete, found), key=lambda f: f.score)

    def pairs(self, first: Fitted) -> list[Fitted]:
        """Second effects beside a fitted first one: screened at its point, raced, the best refined."""
        self.progress(Stage.SECOND, f"beside {first.name}")
        point = self.quick.at(first.point.hypothesis, first.point.u, first.point.x)
        whole = self.own[first.name] if first.name in self.own else self.full.responses(first.point)
        responses = self.kept_rows(whole)
        gram = responses.T @ responses
        starts = screened(self.quick, point, responses, gram)
        return self.refine(
            self.race(starts[:SECOND_SHORTLIST], responses, gram, SECOND_FINALISTS), SECOND_REFINED, whole
        )
