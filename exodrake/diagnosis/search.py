"""Search for what explains a case: retune, screen every effect of the shelf, fit the promising ones, then pairs by forward search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from exodrake.block import Effect
from exodrake.diagnosis.candidates import NOTHING, Hypothesis, hypothesis
from exodrake.diagnosis.fit import Fitter, Point, bounded_solve
from exodrake.diagnosis.problem import Problem

PROBES = (0.35, 1.0)  # amplitudes at which an effect is tried, in units of its typical value
Progress = Callable[[str], None]


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
    def misfit(self) -> float:
        """Mean square residual on the fitted logs [floor^2]."""
        return self.point.misfit

    @property
    def held_misfit(self) -> float:
        """Mean square residual on held-out logs [floor^2]."""
        return float(np.mean(self.held**2))

    @property
    def score(self) -> float:
        """Cost on all logs: what candidates are ranked by."""
        return self.point.cost + 0.5 * float(self.held @ self.held)


@dataclass(frozen=True, eq=False)
class Search:
    """What was tried, best first, with the nominal and the retuned robot beside it."""

    nominal: Fitted
    retuned: Fitted
    singles: tuple[Fitted, ...] = ()
    pairs: tuple[Fitted, ...] = ()
    screened: tuple[tuple[str, float], ...] = field(default=())


class Searcher:
    """The search over hypotheses of one problem."""

    def __init__(self, problem: Problem, progress: Progress = lambda _: None) -> None:
        self.problem, self.progress = problem, progress
        self.fitter = Fitter(problem)
        self.zero = np.zeros(len(self.fitter.knobs))

    def complete(self, point: Point) -> Fitted:
        """A fitted point with its residual on held-out logs."""
        values = self.fitter.values(point.hypothesis, point.u, point.x)
        return Fitted(point, self.problem.residual(values[None], self.problem.holdout)[0])

    def start(self) -> Point:
        """The nominal robot."""
        return self.fitter.at(NOTHING, np.zeros(0), self.zero)

    def shelf(self, point: Point) -> list[Effect]:
        """Effects that are not yet in the hypothesis of a point."""
        return [e for e in self.problem.robot.machine.shelf if e.id not in point.hypothesis.effects]

    def screen(self, point: Point, responses: np.ndarray, gram: np.ndarray) -> list[tuple[float, Hypothesis, np.ndarray, np.ndarray]]:
        """Each effect's linearised cost, with the hypothesis, the amplitudes and the nominal knobs to start its fit from; best first."""
        found = []
        for effect in self.shelf(point):
            extra = hypothesis(self.problem.robot.machine, effect)
            best = None
            for probe in probes(extra):
                tried = self.linearised(point, extra, probe, responses, gram)
                best = tried if best is None or tried[0] < best[0] else best
            assert best is not None
            found.append((best[0], point.hypothesis.joined(extra), best[1], best[2]))
        return sorted(found, key=lambda item: item[0])

    def linearised(self, point: Point, extra: Hypothesis, probe: np.ndarray, responses: np.ndarray, gram: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Cost, u and x of the best combination of the effect's responses lane by lane and of the nominal knobs, within bounds."""
        both = point.hypothesis.joined(extra)
        lanes = [i for i, knob in enumerate(extra.knobs) if knob.first or len(knob.lanes) == 1 and not extra.knobs[0].first]
        rows = []
        for lane in lanes:
            u = np.where([i in lanes and i != lane for i in range(len(probe))], 0.0, probe)
            rows.append(self.fitter.values(both, np.concatenate([point.u, u]), point.x))
        directions = (self.problem.residual(np.array(rows), self.problem.fit) - point.residual).T
        count = len(lanes)
        cross = directions.T @ responses
        normal = np.block([[directions.T @ directions, cross], [cross.T, gram + np.diag(1.0 / self.fitter.spread**2)]])
        normal[np.diag_indices(count)] += 1e-9 * np.trace(normal[:count, :count]) + 1e-9
        descent = -np.concatenate([directions.T @ point.residual, responses.T @ point.residual + point.x / self.fitter.spread**2])
        low, high = extra.bounds[lanes].T
        low, high = np.where(probe[lanes] > 0, low, high) / probe[lanes], np.where(probe[lanes] > 0, high, low) / probe[lanes]
        limit = self.fitter.limit
        move = bounded_solve(normal, descent, np.concatenate([low, -limit - point.x]), np.concatenate([high, limit - point.x]))
        u = probe.copy()
        u[lanes] = probe[lanes] * move[:count]
        cost = point.cost - float(descent @ move) + 0.5 * float(move @ normal @ move)
        return cost, np.concatenate([point.u, u]), point.x + move[count:]


def probes(extra: Hypothesis) -> list[np.ndarray]:
    """Values of u at which an effect's response is measured: two amplitudes, and the ends of a further number's range."""
    found = []
    for amplitude in PROBES:
        u = extra.start
        for i, knob in enumerate(extra.knobs):
            if knob.first:
                u[i] = amplitude * (knob.start if knob.start != 0.0 else knob.scale)
        found.append(u)
    for i, knob in enumerate(extra.knobs):
        if not knob.first and len(knob.lanes) != 1:
            low, high = knob.bounds
            for end in (0.75 * low + 0.25 * high, 0.25 * low + 0.75 * high):
                u = found[0].copy()
                u[i] = end
                found.append(u)
    return found


SHORTLIST, REFINED, SECONDS = 10, 3, 5  # candidates fitted; refined with their own responses; second effects fitted


class Ranking:
    """The course of a search: what is fitted, refined and paired, within a budget."""

    def __init__(self, searcher: Searcher, enough: Callable[[Fitted], bool]) -> None:
        self.s, self.enough = searcher, enough
        self.origin = searcher.start()
        self.responses = searcher.fitter.responses(self.origin)
        self.gram = self.responses.T @ self.responses

    def nominal(self) -> Fitted:
        """The nominal robot."""
        return self.s.complete(self.origin)

    def retuned(self) -> Fitted:
        """The nominal numbers fitted, their responses taken anew once."""
        fitter = self.s.fitter
        point = fitter.fit(self.origin, self.responses, gram=self.gram, steps=4)
        found = self.s.complete(point)
        if self.enough(found):
            return found
        return self.s.complete(fitter.fit(point, fitter.responses(point), steps=4))

    def singles(self) -> tuple[list[Fitted], list[tuple[str, float]]]:
        """The shortlist fitted and its best refined, best first; and the screening costs per sample of all effects."""
        self.s.progress("screening effects")
        screened = self.s.screen(self.origin, self.responses, self.gram)
        found = [self.fitted(h, u, x, self.responses, self.gram) for _, h, u, x in screened[:SHORTLIST]]
        found.sort(key=lambda f: f.score)
        found = self.refined(found, REFINED)
        samples = len(self.origin.residual)
        return found, [(h.name, 2.0 * cost / samples) for cost, h, _, _ in screened]

    def fitted(self, h: Hypothesis, u: np.ndarray, x: np.ndarray, responses: np.ndarray, gram: np.ndarray | None, steps: int = 8) -> Fitted:
        """One hypothesis fitted from a start, which is put within bounds."""
        self.s.progress(h.name)
        fitter = self.s.fitter
        start = fitter.at(h, np.clip(u, *h.bounds.T), np.clip(x, -fitter.limit, fitter.limit))
        return self.s.complete(fitter.fit(start, responses, gram=gram, steps=steps))

    def refined(self, found: list[Fitted], count: int) -> list[Fitted]:
        """The best few fitted on with responses taken at their own points; sorted."""
        fitter = self.s.fitter
        better = []
        for f in found[:count]:
            self.s.progress(f"refining {f.name}")
            responses = fitter.responses(f.point)
            better.append(self.s.complete(fitter.fit(f.point, responses, steps=5)))
        return sorted(better + found[count:], key=lambda f: f.score)

    def pairs(self, first: Fitted) -> list[Fitted]:
        """Second effects beside a fitted first one: screened at its point, fitted, the best refined."""
        self.s.progress(f"a second effect beside {first.name}")
        responses = self.s.fitter.responses(first.point)
        gram = responses.T @ responses
        screened = self.s.screen(first.point, responses, gram)
        found = [self.fitted(h, u, x, responses, gram) for _, h, u, x in screened[:SECONDS]]
        return self.refined(sorted(found, key=lambda f: f.score), 1)
