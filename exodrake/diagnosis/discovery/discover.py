"""Discovery of the free law, among all points of all parts, that best explains the gap beside the effects of a case.

    r = r0 + J x + F c          x: nominal parameters and effects     c_i ~ N(0, s_channel^2): modes of the law

One linear model about the best set screens all laws: x is eliminated, and the scale s of each channel is that of the
largest evidence (MacKay, Neural Computation 4(3), 1992); a channel that the logs do not need gets s = 0. The best few
are fitted through the simulation and compared by their evidence.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from exodrake.core.confidence import ALPHA, NORMAL_90
from exodrake.core.machine import Machine
from exodrake.core.parallel import side_by_side
from exodrake.core.part import HYSTERESIS, RELAXATION
from exodrake.core.plain import plain
from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.core.robot import Robot
from exodrake.diagnosis.closure import measure
from exodrake.diagnosis.discovery.candidates import Candidate, count_values, find_formulas, indices, list_candidates
from exodrake.diagnosis.discovery.law_code import (
    KNOTS,
    SIZE,
    WEIGHTS,
    add_laws,
    effect_text,
    get_laws,
    robot_on,
    robot_with,
    values_on,
)
from exodrake.diagnosis.fit import Explanation, linear_model, minimise, settle, whole_jacobian, without
from exodrake.diagnosis.isolation import Isolation
from exodrake.diagnosis.likelihood import SAMPLE, Likelihood
from exodrake.diagnosis.linear import LinearModel
from exodrake.diagnosis.parameter import Parameter
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import Interval
from exodrake.diagnosis.search import LAW, NATS, NEGLIGIBLE
from exodrake.diagnosis.verdict import LARGE, MOST

SCALES = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)  # of a law in units of its plausible size
MODES, PASSES = 3, 2  # of a law with which it is screened; over the channels in search of their scales
STARTED, PER_POINT = 14, 4  # laws that are simulated as predicted, and at most at one point
FITTED, OTHERS = 3, 1  # laws that are fitted, inside a block and outside it
WIDE = 1e6  # bound of a coordinate: none
SHARES = (1.0, 0.5, 0.2, 0.05)  # of a predicted law, tried where its fit begins
ROUNDS = 2  # new Jacobians of the best law's other parameters, on whole logs
# in 90 % of robots a law in a wrong part takes up less of what the best one in the right part leaves: conformal
# quantile of 24 of the reference simulator, rounded up (docs/missing_law.md); the largest are 0.65, 0.49 and 0.05
LEAD = 0.5
READINGS = ("shown", "delivered")  # points of readings, as in `search.is_memory`


@dataclass(frozen=True, eq=False)
class Curve:
    """A fitted law in one channel."""

    u: np.ndarray  # (points,) abscissas [unit of u]
    value: np.ndarray  # (points,) of the law
    low: np.ndarray  # (points,) ends of its 90 % band
    high: np.ndarray
    edges: np.ndarray  # (bins + 1,) of the histogram of u in the fitted logs
    counts: np.ndarray  # (bins,) its shares
    formula: str = ""  # a plain formula; empty if none is as likely as the curve


class Runner(NamedTuple):
    """A law that was fitted: its id, words, and share of the excess that it removes."""

    id: str
    words: str
    share: float


@dataclass(frozen=True, eq=False)
class MissingLaw:
    """The missing law: a free law, fitted through the simulation, with its evidence."""

    found: bool  # whether the logs show one
    reason: str  # why, in one sentence
    id: str = ""  # of the effect that it is; its first part is the block
    words: str = ""  # what it is over what
    unit: str = ""  # of the variable
    channels: tuple[str, ...] = ()  # that have it; () for the whole robot
    # of the excess over noise that retuning leaves on the fitted logs, removed by it; what nominal parameters use of
    # their tolerances counts as left
    share: float = float("nan")
    p_noise: float = float("nan")  # p-value of that were there noise alone
    runner_up: Runner | None = None  # the best law in another block
    lead: float = float("nan")  # share of what the runner-up leaves above noise that the law takes up
    distinguished: bool = False  # whether it is more than a law in a wrong part takes up of a right one's (`LEAD`)
    others: tuple[Runner, ...] = ()  # laws that were fitted to the end, the named one first
    curves: dict[str, Curve] = field(default_factory=dict)  # channel -> curve
    closure: Interval | None = None  # of the held-out logs, from the retuned robot to that with the law
    held_out: bool = False  # whether these logs were held out
    robot: Robot | None = None  # with the law, on its own machine
    text: str = ""  # source of the effect's module

    @property
    def block(self) -> str:
        """Block of the robot that it acts in."""
        return self.id.split(".")[0]

    def to_json(self) -> dict[str, Any]:
        """The answer as plain data, in SI."""
        return plain({name: value for name, value in vars(self).items() if name not in ("robot", "text")})


@dataclass(frozen=True, eq=False)
class LawFit:
    """A law fitted through the simulation."""

    candidate: Candidate
    scales: np.ndarray  # (channels,) prior standard deviations of its modes; 0 where it is absent
    explanation: Explanation  # coordinates of the law's modes are the last ones
    likelihood: Likelihood  # views of the case that were fitted

    @property
    def block(self) -> str:
        """Block of the robot that the law acts in."""
        return self.candidate.law.block

    @property
    def is_memory(self) -> bool:
        """Whether the law is the memory of a reading."""
        return self.candidate.form.kind in (HYSTERESIS, RELAXATION) and self.candidate.law.point.name in READINGS

    @property
    def active(self) -> list[int]:
        """Positions of the channels that have the law."""
        return np.flatnonzero(self.scales).tolist()

    @property
    def beside(self) -> int:
        """Number of the other parameters."""
        return len(self.explanation.x) - SIZE * len(self.active)

    @property
    def modes(self) -> np.ndarray:
        """Coordinates of the law (channels, 8)."""
        found = np.zeros((len(self.scales), SIZE))
        found[self.active] = self.explanation.x[self.beside :].reshape(-1, SIZE)
        return found

    @property
    def weights(self) -> np.ndarray:
        """Weights of the law (channels, 8)."""
        return self.candidate.size[:, None] * (self.modes @ self.candidate.basis.T)

    @cached_property
    def model(self) -> LinearModel:
        """The linear model about the fit."""
        memory = self.likelihood.with_memory(self.explanation.residual)
        return linear_model(memory.scaled_to(self.explanation.residual), self.explanation)

    def evidence(self, memory: float) -> float:
        """Log evidence [nats], so many frames as one."""
        return replace(self.model, memory=memory).evidence()


def discover(
    problem: Problem, found: Isolation, progress: StageProgress = no_progress, blocks: Collection[str] = ()
) -> MissingLaw:
    """The law that is missing in a case: the most likely one at any point.

    Laws are sought beside the retuned robot, and beside the best set of effects where that explains half of the gap.

    Args:
        problem: the case.
        found: its isolation.
        progress: called with the stage and the law that is worked on.
        blocks: of the robot whose points are tried; all where empty.
    """
    accepted = found.best if 1.0 - found.search.measure_left(found.best) >= MOST else found.retuned
    if found.negligible(accepted.explanation.robot):
        who = accepted.explanation.name if accepted.effects else "retuning"
        return MissingLaw(False, f"what {who} leaves is negligible: no law is missing")
    progress(Stage.LINEARISE, "free laws")
    bare = problem.robot.machine
    machine = add_laws(bare)
    whole = replace(found.whole, robot=robot_on(found.whole.robot, machine))
    laws = [law for law in get_laws(bare) if not blocks or law.block in blocks]
    groups: list[tuple[Likelihood, Explanation, list[Candidate], list[LawFit]]] = []
    for known in {id(f): f for f in (accepted, found.retuned)}.values():
        likelihood, base = put_on(machine, found.likelihood, known.explanation)
        tried = list_candidates(whole, base.robot, laws)
        screened = sorted(side_by_side([partial(screen, likelihood, base, c) for c in tried]), key=lambda s: -s.gain)
        groups.append((likelihood, base, tried, fit_best(likelihood, base, screened, progress)))
    memory = min((fit.model.memory for *_, fits in groups for fit in fits), default=1.0)
    evidence = [max((fit.evidence(memory) for fit in fits), default=-np.inf) for *_, fits in groups]
    likelihood, base, tried, fits = groups[int(np.argmax(evidence))]
    if not fits:
        return MissingLaw(False, "the logs are as likely without any law as with one", p_noise=1.0)
    fits.sort(key=lambda fit: -fit.evidence(memory))
    shares = [share_removed(likelihood, base, fit.explanation) for fit in fits]
    order = rank(fits, shares)
    fits, shares = [fits[k] for k in order], [shares[k] for k in order]
    fitted = [(fit.candidate.law.learned, fit.candidate.form.words) for fit in fits]
    others = tuple(Runner(*names, share) for names, share in zip(fitted, shares, strict=True))
    best, memory, rest = fits[0], fits[0].model.memory, base.name if base.effects else "retuning"
    gain = best.evidence(memory) - replace(linear_model(likelihood, base), memory=memory).evidence()
    # evidence exceeds exp(g) times that of no law with probability exp(-g) at most (Markov); any of those tried may
    p = float(min(1.0, len(tried) * len(SCALES) * np.exp(-gain)))
    if p > ALPHA:
        reason = f"no law takes up more than noise lets one (p = {p:.2g})"
        return MissingLaw(False, reason, p_noise=p, others=others)
    if shares[0] < LARGE:
        reason = f"the best law, {best.candidate.name}, removes only {shares[0]:.0%} of what {rest} leaves"
        return MissingLaw(False, reason, p_noise=p, others=others)
    progress(Stage.CLOSURE, best.candidate.name)
    best = fit_whole_logs(drop_needless(best), whole)
    candidate, weights = best.candidate, best.weights
    rival = next((k for k, fit in enumerate(fits) if fit.block != best.block), None)
    ahead = 1.0 if rival is None else lead(shares[0], shares[rival])
    rows = np.array([values_on(found.whole.silent(), bare, machine), base.robot, best.explanation.robot])
    curves = draw_curves(best, count_values(whole, base.robot, candidate))
    short = {name: curve.formula for name, curve in curves.items() if curve.formula}
    strongest = int(abs(weights).max(axis=1).argmax())
    at = candidate.knots[strongest], weights[strongest]
    text = effect_text(candidate.law, candidate.form, *at, problem.case.name, short)
    # the robot with the law as an effect, noise and resolutions as they were
    values = best.explanation.robot[[machine.index[p.name] for p in bare.parameters]]
    values = np.where(values != replace(found.whole, detected=()).silent(), values, found.whole.robot.values)
    robot = replace(found.whole.robot, values=values)
    return MissingLaw(
        found=True,
        reason=f"a free law of {others[0].words} at {candidate.law.key} removes {shares[0]:.0%} of what {rest} leaves",
        id=others[0].id,
        words=others[0].words,
        unit=candidate.form.unit,
        channels=tuple(name for name in (candidate.channels[i] for i in best.active) if name),
        share=shares[0],
        p_noise=p,
        runner_up=None if rival is None else others[rival],
        lead=ahead,
        distinguished=ahead > LEAD,
        others=others,
        curves=curves,
        closure=measure(whole, [rows] * len(whole.judged)).effect,
        held_out=bool(whole.holdout),
        robot=robot_with(robot, text, candidate.channels, candidate.knots, weights),
        text=text,
    )


def put_on(machine: Machine, likelihood: Likelihood, e: Explanation) -> tuple[Likelihood, Explanation]:
    """A likelihood and an explanation on their machine with further effects."""
    before = likelihood.robot.machine
    problems = [replace(view.problem, robot=robot_on(view.problem.robot, machine)) for view in likelihood.views]
    views = tuple(replace(view, problem=p) for view, p in zip(likelihood.views, problems, strict=True))
    index = [machine.index[p.name] for p in before.parameters]
    parameters = tuple(replace(p, index=tuple(index[i] for i in p.index)) for p in e.parameters)
    memory = min(likelihood.memory, max(SAMPLE / machine.frame, 1.0))
    likelihood = replace(likelihood, views=views, memory=memory).for_stage("discover").scaled_to(e.residual)
    return likelihood, e.change(parameters=parameters, values=values_on(e.values, before, machine))


class Screened(NamedTuple):
    """A law as the linear model predicts it."""

    gain: float  # of log evidence [nats]
    candidate: Candidate
    scales: np.ndarray  # (channels,) of its prior
    x: np.ndarray  # coordinates, those of the parameters beside it first


def screen(likelihood: Likelihood, base: Explanation, candidate: Candidate) -> Screened:
    """A candidate by the linear model about a robot without it."""
    count, channels = len(base.x), len(candidate.channels)
    with_it = join_law(likelihood.robot.machine, base, candidate, np.ones(channels), MODES)
    moved = with_it.at_each(likelihood, [np.r_[base.x, unit] for unit in np.eye(MODES * channels)])
    directions = np.array([e.residual for e in moved]) - base.residual
    rows = np.concatenate([whole_jacobian(likelihood, base), directions, base.residual[None]])
    flat, (low, high) = np.zeros(len(directions)), base.bounds - base.x
    ends = np.r_[low, flat - np.inf], np.r_[high, flat + np.inf]
    prior = (np.r_[-base.x, flat], np.r_[1.0 / base.prior_std**2, flat], *ends)
    reduced = LinearModel.of_rows(rows, likelihood.blocks, prior, likelihood.memory).eliminate(count)
    scales, found, gain = weigh_scales(reduced.normal, reduced.slope, np.repeat(np.arange(channels), MODES))
    modes = np.zeros((channels, SIZE))
    modes[:, :MODES] = found.reshape(channels, MODES)
    x = np.r_[base.x + reduced.others(np.arange(len(found)), found), modes[scales > 0.0].ravel()]
    return Screened(gain, candidate, scales, x)


def weigh_scales(normal: np.ndarray, slope: np.ndarray, channel: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Prior scales (channels,) of largest evidence, coordinates (n,) with them, and the log evidence beyond none.

    Of a cost c's + c'Nc / 2 of coordinates c of some channels (n,), others eliminated: N (n, n), s (n,).
    """

    def weigh(scales: np.ndarray) -> tuple[float, np.ndarray]:
        prior = scales[channel]
        whole = np.eye(len(prior)) + normal * np.outer(prior, prior)
        solved = np.linalg.solve(whole, prior * slope)
        return float(0.5 * (prior * slope) @ solved - 0.5 * np.linalg.slogdet(whole)[1]), -prior * solved

    scales = np.ones(int(channel.max()) + 1)
    for c in np.tile(np.arange(len(scales)), PASSES):
        trials = [np.where(np.arange(len(scales)) == c, s, scales) for s in SCALES]
        scales = max(trials, key=lambda trial: weigh(trial)[0])
    gain, modes = weigh(scales)
    return scales, modes, gain


def join_law(
    machine: Machine, base: Explanation, candidate: Candidate, scales: np.ndarray, modes: int = SIZE
) -> Explanation:
    """An explanation with the first modes of a law, at weights of 0; scales: (channels,) of their prior, 0 for none."""
    at = {name: indices(machine, candidate.law.identity, name) for name in ("form", *KNOTS, *WEIGHTS)}
    values, parameters, active = base.values.copy(), list(base.parameters), np.flatnonzero(scales)
    values[at["form"][active]] = float(candidate.number)
    for knot, name in zip(candidate.knots.T, KNOTS, strict=True):
        values[at[name]] = knot
    for c in active:
        index, channel = tuple(int(at[name][c]) for name in WEIGHTS), candidate.channels[c]
        for m, weights in enumerate((candidate.size[c] * candidate.basis).T[:modes]):
            name, along, std = f"mode{m + 1}.{channel}", tuple(map(float, weights)), float(scales[c])
            parameters.append(Parameter(name, index, "along", 0.0, std, (-WIDE, WIDE), "", (channel,), along=along))
    x = np.r_[base.x, np.zeros(len(parameters) - len(base.x))]
    return Explanation(base.effects, tuple(parameters), x, values, base.residual, base.jacobian)


def fit_best(
    likelihood: Likelihood, base: Explanation, screened: Sequence[Screened], progress: StageProgress
) -> list[LawFit]:
    """The most promising laws fitted, in the block of the best one and outside it."""
    machine = likelihood.robot.machine

    def start(s: Screened) -> LawFit:
        """A screened law simulated with as much of its predicted weights as fits best."""
        e = join_law(machine, base, s.candidate, s.scales)
        tried = e.at_each(likelihood, [e.x + share * (s.x - e.x) for share in SHARES])
        return LawFit(s.candidate, s.scales, min((e, *tried), key=lambda one: one.cost(likelihood)), likelihood)

    def fit_law(begun: LawFit) -> LawFit:
        """A law fitted, its scales those of the largest evidence about a first fit."""
        first = minimise(likelihood.scaled_to(begun.explanation.residual), begun.explanation, 2)
        fit = replace(begun, explanation=settle(likelihood, first))
        reduced = replace(fit.model, memory=likelihood.memory).eliminate(fit.beside)
        slope = reduced.slope - reduced.normal @ fit.explanation.x[fit.beside :]
        scales = np.zeros(len(fit.scales))
        scales[fit.active] = weigh_scales(reduced.normal, slope, np.repeat(np.arange(len(fit.active)), SIZE))[0]
        if not scales.any():
            return fit
        e = join_law(machine, base, fit.candidate, scales)
        x = np.r_[fit.explanation.x[: fit.beside], fit.modes[scales > 0.0].ravel()]
        e = replace(e, jacobian=fit.explanation.jacobian).at(likelihood, x)
        e = minimise(likelihood.scaled_to(e.residual), e)
        return LawFit(fit.candidate, scales, e, likelihood)

    chosen: list[Screened] = []
    for s in (s for s in screened if s.scales.any()):
        if sum(c.candidate.law is s.candidate.law for c in chosen) < PER_POINT and len(chosen) < STARTED:
            chosen.append(s)
    starts = side_by_side([partial(start, s) for s in chosen])
    starts.sort(key=lambda fit: fit.explanation.cost(likelihood))
    inside, outside = ([f for f in starts if (f.block == starts[0].block) is here] for here in (True, False))
    wanted = [*inside[:FITTED], *outside[:OTHERS]]
    progress(Stage.FIT, ", ".join(dict.fromkeys(f.candidate.law.learned for f in wanted)))
    return side_by_side([partial(fit_law, f) for f in wanted])


def share_removed(likelihood: Likelihood, base: Explanation, e: Explanation) -> float:
    """Share of what an explanation leaves above noise that another removes, the mean of the views that have any."""
    before, after = (np.maximum(likelihood.chi2(one.residual) - 1.0, 0.0) for one in (base, e))
    wide = before > NEGLIGIBLE**2
    return float(np.mean(1.0 - after[wide] / before[wide])) if wide.any() else 0.0


def lead(share: float, other: float) -> float:
    """Share of what another law leaves above noise that a law takes up; both of which remove a share of the excess.

    A share below 0 is that of a fit that ended early: with no law at all it is 0.
    """
    return 1.0 - (1.0 - share) / max(1.0 - max(other, 0.0), 1e-9)


def rank(fits: Sequence[LawFit], shares: Sequence[float]) -> list[int]:
    """Order of fits of falling evidence; the memory of a reading, which imitates any cause, behind another law.

    That law removes as much but for errors of laws.
    """
    order = list(range(len(fits)))
    causes = [k for k in order if not fits[k].is_memory and shares[k] >= (1.0 - LAW) * shares[0]]
    return [causes[0], *(k for k in order if k != causes[0])] if causes and fits[0].is_memory else order


def drop_needless(fit: LawFit) -> LawFit:
    """A law without the effects beside it that no longer earn their place."""
    for effect in fit.explanation.effects:
        start = without(fit.likelihood, fit.explanation, effect)
        trial = replace(fit, explanation=minimise(fit.likelihood.scaled_to(start.residual), start))
        memory = fit.model.memory
        if fit.evidence(memory) - trial.evidence(memory) < NATS:
            fit = trial
    return fit


def fit_whole_logs(fit: LawFit, whole: Problem) -> LawFit:
    """A law fitted to whole logs, `ROUNDS` times with new derivatives by the other parameters."""
    likelihood = fit.likelihood.on(whole)
    e = fit.explanation.at(likelihood, fit.explanation.x)
    e = replace(e, jacobian=np.zeros((e.nominal, len(e.residual)), dtype=np.float32))
    for _ in range(ROUNDS):
        e = settle(likelihood, e, np.ones(e.nominal, dtype=bool))
    return replace(fit, explanation=e, likelihood=likelihood)


def draw_curves(fit: LawFit, counts: np.ndarray) -> dict[str, Curve]:
    """The law in each channel, with its 90 % band and the histogram of its variable, counts (channels, bins)."""
    candidate, model, found = fit.candidate, fit.model, {}
    samples, own = float(model.effective.sum()), fit.modes[fit.active].ravel()
    short = find_formulas(candidate, fit.active, model.eliminate(fit.beside), own, fit.scales[fit.active], samples)
    at, shape = candidate.shape()
    covariance = model.posterior().covariance[fit.beside :, fit.beside :]
    for i, channel in enumerate(fit.active):
        place = slice(i * SIZE, (i + 1) * SIZE)
        to_values = shape[channel] @ (candidate.size[channel] * candidate.basis)
        half = NORMAL_90 * np.sqrt(np.einsum("ij,jk,ik->i", to_values, covariance[place, place], to_values))
        value, name = shape[channel] @ fit.weights[channel], candidate.channels[channel]
        edges = np.linspace(candidate.low[channel], candidate.high[channel], counts.shape[1] + 1)
        share = counts[channel] / max(float(counts[channel].sum()), 1.0)
        found[name] = Curve(at[channel], value, value - half, value + half, edges, share, short.get(name, ""))
    return found
