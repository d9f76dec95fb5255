"""Search for what explains a case: retune, screen every effect of the shelf, fit the promising ones, then pairs by forward search."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from exodrake.block import Effect
from exodrake.diagnosis import nuisance
from exodrake.diagnosis.candidates import NOTHING, Hypothesis, Knob, hypothesis
from exodrake.diagnosis.fit import Fitter, Point, bounded_solve
from exodrake.diagnosis.line import TREMOR, Line, find, tremor
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.vocabulary import COMMON

PROBE = 0.6  # amplitude at which an effect is tried, in units of its typical value
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
    """What was tried, best first, with the nominal and the retuned robot beside it.

    lossy: commands were seen to be lost, though that does not close the gap: what was lost unseen cannot be repeated.
    shaking: a line that was seen in the spectrum, and the robot with the tremor that leaves it: its phase cannot be repeated, either.
    """

    nominal: Fitted
    retuned: Fitted
    singles: tuple[Fitted, ...] = ()
    pairs: tuple[Fitted, ...] = ()
    screened: tuple[tuple[str, float], ...] = field(default=())
    lossy: bool = False
    shaking: tuple[Line, Fitted] | None = None


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
        """Common effects that are not yet in the hypothesis of a point."""
        return [e for e in self.problem.robot.machine.shelf if e.id in COMMON and e.id not in point.hypothesis.effects]

    def screen(
        self, point: Point, responses: np.ndarray, gram: np.ndarray
    ) -> list[tuple[float, Hypothesis, np.ndarray, np.ndarray]]:
        """Each effect's linearised cost, with the hypothesis, the amplitudes and the nominal knobs to start its fit from; best first."""
        found = []
        for effect in self.shelf(point):
            extra = hypothesis(self.problem.robot.machine, effect)
            best = None
            for probe in probes(extra):
                tried = self.linearised(point, extra, probe, responses, gram)
                best = tried if best is None or tried[0] < best[0] else best
            for whole in turns(extra):
                tried = self.linearised(point, extra, whole, responses, gram, lanes=())
                best = tried if best is None or tried[0] < best[0] else best
            assert best is not None
            found.append((best[0], point.hypothesis.joined(extra), best[1], best[2]))
        return sorted(found, key=lambda item: item[0])

    def linearised(
        self,
        point: Point,
        extra: Hypothesis,
        probe: np.ndarray,
        responses: np.ndarray,
        gram: np.ndarray,
        lanes: Sequence[int] | None = None,
    ) -> tuple[float, np.ndarray, np.ndarray]:
        """Cost, u and x of the best combination of the effect's responses lane by lane and of the nominal knobs, within bounds.

        lanes: knobs whose amplitudes may be scaled, all first ones by default; with none the probe is taken as it is.
        """
        both = point.hypothesis.joined(extra)
        lanes = [i for i, knob in enumerate(extra.knobs) if knob.first] if lanes is None else list(lanes)
        rows = [
            self.fitter.values(both, np.concatenate([point.u, alone(probe, lanes, lane)]), point.x)
            for lane in lanes or [0]
        ]
        directions = (self.problem.residual(np.array(rows), self.problem.fit) - point.residual).T
        count = directions.shape[1]
        cross = directions.T @ responses
        normal = np.block([[directions.T @ directions, cross], [cross.T, gram + np.diag(1.0 / self.fitter.spread**2)]])
        normal[np.diag_indices(count)] += 1e-9 * np.trace(normal[:count, :count]) + 1e-9
        descent = -np.concatenate(
            [directions.T @ point.residual, responses.T @ point.residual + point.x / self.fitter.spread**2]
        )
        low, high = amplitude_bounds(extra, probe, lanes)
        limit = self.fitter.limit
        move = bounded_solve(
            normal, descent, np.concatenate([low, -limit - point.x]), np.concatenate([high, limit - point.x])
        )
        u = probe.copy()
        u[lanes] = probe[lanes] * move[:count]
        cost = point.cost - float(descent @ move) + 0.5 * float(move @ normal @ move)
        return cost, np.concatenate([point.u, u]), point.x + move[count:]


def alone(probe: np.ndarray, lanes: list[int], lane: int) -> np.ndarray:
    """The probe with all other lanes at neutral; as it is for an effect that is on or off."""
    u = probe.copy()
    u[[i for i in lanes if i != lane]] = 0.0
    return u


def amplitude_bounds(extra: Hypothesis, probe: np.ndarray, lanes: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """How far each direction may be scaled; an effect that is on or off is taken as it is."""
    if not lanes:
        return np.array([1.0]), np.array([1.0 + 1e-9])
    ends = extra.bounds[lanes] / probe[lanes][:, None]
    return ends.min(axis=1), ends.max(axis=1)


def probes(extra: Hypothesis) -> list[np.ndarray]:
    """Values of u at which an effect's response is measured: a modest amplitude, and both ends of further numbers known by order only."""
    if not any(knob.first for knob in extra.knobs):
        return []
    first = extra.start
    for i, knob in enumerate(extra.knobs):
        if knob.first:
            first[i] = PROBE * (knob.start if knob.start != 0.0 else knob.scale)
    found = [first]
    for i, knob in enumerate(extra.knobs):
        if not knob.first and (len(knob.lanes) > 1 or knob.lanes == ("",)):
            found += [elsewhere(first, i, value) for value in other_values(knob, first[i])]
    return found


def elsewhere(u: np.ndarray, i: int, value: float) -> np.ndarray:
    """u with its entry i at `value`."""
    moved = u.copy()
    moved[i] = value
    return moved


def other_values(knob: Knob, usual: float) -> list[float]:
    """Where a further number is tried besides its usual value: well inside its range, on the side where there is more of it."""
    low, high = knob.bounds
    return [FAR * high + (1.0 - FAR) * low if usual < 0.5 * (low + high) else FAR * low + (1.0 - FAR) * high]


def turns(extra: Hypothesis) -> list[np.ndarray]:
    """Values of u to be taken as they are, for effects whose response is not proportional to them (a contact, a clipped current, a
    direction of gravity): the plausible range of one number for the whole robot, the usual amount on all lanes at once."""
    lead = extra.knobs[0]
    if lead.first and lead.lanes != ("",):
        return [extra.start]
    ends = sorted((lead.at(lead.number.low), lead.at(lead.number.high))) if lead.first else lead.bounds
    return [np.concatenate([[value], extra.start[1:]]) for value in np.linspace(*ends, TURNS)]


FAR = 0.7  # of the way through its range at which a further number is tried
TURNS = 5  # values at which an effect of the whole robot is tried


LOSING = "timing.dropped_commands"
SHARE = 0.6  # of each trial: what screening and racing see
SHORTLIST, SURVIVORS, REFINED = 12, 3, 2  # effects raced; fitted to the end; refined on whole trials
FEW = 4, 2, 1  # the same where retuned numbers explain a case: what could be there is small, and screening it linear
SECONDS, SECOND_SURVIVORS = 6, 2  # the same for second effects
RETUNES, SETTLED = (
    4,
    0.1,
)  # rounds at most; one that lowers the cost by less than this share is the last: they converge quadratically
NEARBY = (
    60.0  # misfit [floor^2] of the retuned robot below which effects are screened from it, and not from the nominal one
)
CONTENDS = 1.5  # a candidate whose misfit is within this factor of the best one's is refined, too
LEAPS, LEAP_GAIN = (
    (-0.6, -0.3, 0.3, 0.6),
    50.0,
)  # of a stop's limit, where it is tried; gain of cost that is worth a fit
FLOORED = 1.02  # misfit [floor^2] at which a fit has converged for all purposes
HOPELESS = 4.0  # a candidate whose misfit is this many times the best one's after two steps is dropped


class Ranking:
    """The course of a search: what is fitted, refined and paired."""

    def __init__(self, problem: Problem, progress: Progress = lambda _: None) -> None:
        self.full, self.quick = Searcher(problem, progress), Searcher(problem.shortened(SHARE), progress)
        self.progress = progress
        self.origin = self.full.start()
        self.base = self.origin
        self.responses: np.ndarray | None = None
        self.own: dict[str, np.ndarray] = {}

    def nominal(self) -> Fitted:
        """The nominal robot."""
        return self.full.complete(self.origin)

    def retuned(self) -> Fitted:
        """The nominal numbers fitted, their responses taken anew until that gains no more."""
        self.progress("retuning the nominal numbers")
        fitter, point = self.full.fitter, self.origin
        for _ in range(RETUNES):
            responses = fitter.responses(point)
            self.responses = responses if self.responses is None else self.responses
            better = fitter.fit(point, responses, steps=8)
            better = self.leapt(better, responses)
            if better.misfit < NEARBY:
                self.base, self.responses = better, responses
            gain, point = point.cost - better.cost, better
            if gain < SETTLED * better.cost:
                break
        return self.full.complete(point)

    def leapt(self, point: Point, responses: np.ndarray) -> Point:
        """The point, or a better one with an end stop elsewhere: it is met suddenly, and a fit that starts on its wrong side stays there."""
        fitter = self.full.fitter
        for i in (i for i, knob in enumerate(fitter.knobs) if knob.name.startswith(nuisance.SUDDEN)):
            best = min(
                (fitter.leap(point, responses, i, share * fitter.limit[i]) for share in LEAPS),
                key=lambda found: found[0],
            )
            if best[0] < point.cost - LEAP_GAIN:
                trial = fitter.fit(best[1], responses, steps=8)
                point = trial if trial.cost < point.cost else point
        return point

    def singles(self, quiet: bool = False) -> tuple[list[Fitted], list[tuple[str, float]]]:
        """The shortlist raced, fitted and refined, best first; and the screening misfits of all effects. quiet: see `FEW`."""
        self.progress("screening effects")
        assert self.responses is not None
        kept, base = self.kept_rows(self.responses), self.quick.fitter.at(NOTHING, np.zeros(0), self.base.x)
        gram = kept.T @ kept
        screened = self.quick.screen(base, kept, gram)
        shortlist, survivors, refined = FEW if quiet else (SHORTLIST, SURVIVORS, REFINED)
        found = self.race(screened[:shortlist], kept, gram, survivors)
        best = self.refine(found, refined, self.responses)
        return best, [(h.name, 2.0 * cost / len(base.residual)) for cost, h, _, _ in screened]

    def second_alone(self, pair: Fitted) -> Fitted:
        """The second effect of a pair fitted without the first, which may only have stood in for it when singles were screened."""
        assert self.responses is not None
        machine, both = self.full.problem.robot.machine, pair.point.hypothesis
        alone = hypothesis(machine, machine.effect(both.effects[-1]))
        u = pair.point.u[[both.knobs.index(knob) for knob in alone.knobs]]
        self.progress(f"{alone.name} alone")
        start = self.full.fitter.at(alone, u, pair.point.x)
        return self.full.complete(self.full.fitter.fit(start, self.responses, steps=8))

    def losing(self, singles: list[Fitted]) -> Fitted:
        """The fit of lost commands alone."""
        for f in singles:
            if f.name == LOSING:
                return f
        h = hypothesis(self.full.problem.robot.machine, self.full.problem.robot.machine.effect(LOSING))
        assert self.responses is not None
        return self.full.complete(
            self.full.fitter.fit(self.full.fitter.at(h, h.start, self.base.x), self.responses, steps=4)
        )

    def shaking(self, fitted: Fitted) -> tuple[Line, Fitted] | None:
        """The line of a tremor in what a robot leaves, if there is one, and the robot with that tremor."""
        problem = self.full.problem
        if all(effect.id != TREMOR for effect in problem.robot.machine.shelf):
            return None
        logs, at = [], 0
        for trial in problem.fit:
            logs.append(fitted.point.residual[at : at + trial.measured.size].reshape(trial.measured.shape))
            at += trial.measured.size
        line = find(problem, logs)
        if not line.certain:
            return None
        both, u = tremor(self.full.fitter, fitted.point, line)
        return line, self.full.complete(self.full.fitter.at(both, u, fitted.point.x))

    def kept_rows(self, responses: np.ndarray) -> np.ndarray:
        """Rows of whole-trial responses that belong to the shortened trials."""
        columns, parts, at = len(self.full.problem.columns), [], 0
        for whole, part in zip(self.full.problem.fit, self.quick.problem.fit, strict=True):
            parts.append(responses[at : at + columns * len(part.reference)])
            at += columns * len(whole.reference)
        return np.concatenate(parts)

    def race(self, entries: list, responses: np.ndarray, gram: np.ndarray, survivors: int) -> list[Point]:
        """Points after two steps each, the hopeless dropped and the survivors fitted to the end; best first."""
        fitter, points = self.quick.fitter, []
        for _, h, u, x in entries:
            self.progress(h.name)
            start = fitter.at(h, np.clip(u, *h.bounds.T), np.clip(x, -fitter.limit, fitter.limit))
            points.append(fitter.fit(start, responses, steps=2, gram=gram))
        points.sort(key=lambda p: p.cost)
        hopeful = [p for p in points[:survivors] if p.misfit < HOPELESS * points[0].misfit]
        ended = [fitter.fit(p, responses, steps=6, gram=gram) for p in hopeful]
        return sorted([*ended, *points[len(hopeful) :]], key=lambda p: p.cost)

    def refine(self, points: list[Point], count: int, responses: np.ndarray) -> list[Fitted]:
        """The best few fitted on whole trials, the contenders among them with responses taken at their own points; the rest as they
        are. Best first. responses: of a point nearby (samples, nominal knobs)."""
        fitter, found = self.full.fitter, []
        for k, p in enumerate(points):
            start = fitter.at(p.hypothesis, p.u, p.x)
            if k < count:
                self.progress(f"refining {p.hypothesis.name}")
                start = fitter.fit(start, responses, steps=8)
            found.append(start)
        found.sort(key=lambda p: p.cost)
        for k, p in enumerate(found[:count]):
            if p.misfit > FLOORED and (k == 0 or p.misfit < CONTENDS * found[0].misfit):
                self.own[p.hypothesis.name] = fitter.responses(p)
                found[k] = fitter.fit(p, self.own[p.hypothesis.name], steps=4)
        return sorted(map(self.full.complete, found), key=lambda f: f.score)

    def pairs(self, first: Fitted) -> list[Fitted]:
        """Second effects beside a fitted first one: screened at its point, raced, the best refined."""
        self.progress(f"a second effect beside {first.name}")
        point = self.quick.fitter.at(first.point.hypothesis, first.point.u, first.point.x)
        whole = self.own[first.name] if first.name in self.own else self.full.fitter.responses(first.point)
        responses = self.kept_rows(whole)
        gram = responses.T @ responses
        screened = self.quick.screen(point, responses, gram)
        return self.refine(self.race(screened[:SECONDS], responses, gram, SECOND_SURVIVORS), 1, whole)
