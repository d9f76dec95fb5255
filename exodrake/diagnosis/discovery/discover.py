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
from exodrake.diagnosis.discovery.candidates import Candidate, find_formulas, list_candidates, run_watches
from exodrake.diagnosis.discovery.law_code import (
    COUNTS,
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


class Screened(NamedTuple):
    """A law as the linear model predicts it."""

    gain: float  # of log evidence [nats]
    candidate: Candidate
    scales: np.ndarray  # (channels,) of its prior
    x: np.ndarray  # coordinates, those of the parameters beside it first


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
    if found.excess(accepted.explanation.robot) < 0.0:
        who = accepted.explanation.name if accepted.effects else "retuning"
        return MissingLaw(False, f"what {who} leaves is negligible: no law is missing")
    progress(Stage.LINEARISE, "free laws")
    machine = add_laws(problem.robot.machine)
    whole = replace(found.whole, robot=robot_on(found.whole.robot, machine))
    laws = [law for law in get_laws(problem.robot.machine) if not blocks or law.block in blocks]
    groups: list[tuple[Likelihood, Explanation, int, list[LawFit]]] = []
    for known in {id(f): f for f in (accepted, found.retuned)}.values():
        likelihood, base = put_on(machine, found.likelihood, known.explanation)
        tried = list_candidates(whole, base.robot, laws)
        screened = sorted(side_by_side([partial(screen, likelihood, base, c) for c in tried]), key=lambda s: -s.gain)
        groups.append((likelihood, base, len(tried), fit_best(likelihood, base, screened, progress)))
    memory = min((fit.model.memory for *_, fits in groups for fit in fits), default=1.0)
    evidence = [max((fit.evidence(memory) for fit in fits), default=-np.inf) for *_, fits in groups]
    likelihood, base, tried, fits = groups[int(np.argmax(evidence))]
    if not fits:
        return MissingLaw(False, "the logs are as likely without any law as with one", p_noise=1.0)
    fits.sort(key=lambda fit: -fit.evidence(memory))
    before = np.maximum(likelihood.chi2(base.residual) - 1.0, 0.0)
    wide = before > NEGLIGIBLE**2
    after = [np.maximum(likelihood.chi2(fit.explanation.residual) - 1.0, 0.0) for fit in fits]
    shares = [float(np.mean(1.0 - left[wide] / before[wide])) if wide.any() else 0.0 for left in after]
    # the memory of a reading imitates any cause: a law that removes as much, but for errors of laws, goes before it
    causes = [k for k, share in enumerate(shares) if not fits[k].is_memory and share >= (1.0 - LAW) * shares[0]]
    if fits[0].is_memory and causes:
        fits.insert(0, fits.pop(causes[0]))
        shares.insert(0, shares.pop(causes[0]))
    others = tuple(
        Runner(f.candidate.law.learned, f.candidate.form.words, s) for f, s in zip(fits, shares, strict=True)
    )
    best, memory, rest = fits[0], fits[0].model.memory, base.name if base.effects else "retuning"
    gain = best.evidence(memory) - replace(linear_model(likelihood, base), memory=memory).evidence()
    # evidence exceeds exp(g) times that of no law with probability exp(-g) at most (Markov); any of those tried may
    p = float(min(1.0, tried * len(SCALES) * np.exp(-gain)))
    if p > ALPHA:
        reason = f"no law takes up more than noise lets one (p = {p:.2g})"
        return MissingLaw(False, reason, p_noise=p, others=others)
    if shares[0] < LARGE:
        reason = f"the best law, {best.candidate.name}, removes only {shares[0]:.0%} of what {rest} leaves"
        return MissingLaw(False, reason, p_noise=p, others=others)
    progress(Stage.CLOSURE, best.candidate.name)
    for effect in best.explanation.effects:  # without those that no longer earn their place beside it
        start = without(best.likelihood, best.explanation, effect)
        trial = replace(best, explanation=minimise(best.likelihood.scaled_to(start.residual), start))
        if best.evidence(best.model.memory) - trial.evidence(best.model.memory) < NATS:
            best = trial
    # on whole logs, until no step with a new Jacobian of the other parameters leads further
    on_whole = best.likelihood.on(whole)
    e = best.explanation.at(on_whole, best.explanation.x)
    e = replace(e, jacobian=np.zeros((e.nominal, len(e.residual)), dtype=np.float32))
    for _ in range(ROUNDS):
        e = settle(on_whole, e, np.ones(e.nominal, dtype=bool))
    best = replace(best, explanation=e, likelihood=on_whole)
    candidate, robot = best.candidate, best.explanation.robot
    weights = candidate.size[:, None] * (best.modes @ candidate.basis.T)
    rival = next((k for k, fit in enumerate(fits) if fit.block != best.block), None)
    # share of what the runner-up leaves that the law takes up; below 0 a fit ended early: with no law at all it is 0
    lead = 1.0 if rival is None else 1.0 - (1.0 - shares[0]) / max(1.0 - max(shares[rival], 0.0), 1e-9)
    watched = {"form": float(candidate.number), "low": candidate.low, "high": candidate.high}
    states = run_watches(whole, base.robot, {candidate.law.identity: watched})[candidate.law.identity]
    curves = draw_curves(best, weights, np.array([states[c].sum(axis=0) for c in COUNTS]).T)
    short = {name: curve.formula for name, curve in curves.items() if curve.formula}
    strongest = int(abs(weights).max(axis=1).argmax())
    at = candidate.knots[strongest], weights[strongest]
    text = effect_text(candidate.law, candidate.form, *at, problem.case.name, short)
    bare, nominal = found.whole.robot, found.whole.silent()
    rows = np.array([values_on(nominal, bare.machine, machine), base.robot, robot])
    # the robot with the law as an effect, noise and resolutions as they were
    values = robot[[machine.index[p.name] for p in bare.machine.parameters]]
    values = np.where(values != replace(found.whole, detected=()).silent(), values, bare.values)
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
        lead=lead,
        distinguished=lead > LEAD,
        others=others,
        curves=curves,
        closure=measure(whole, [rows] * len(whole.judged)).effect,
        held_out=bool(whole.holdout),
        robot=robot_with(replace(bare, values=values), text, candidate.channels, candidate.knots, weights),
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


def screen(likelihood: Likelihood, base: Explanation, candidate: Candidate) -> Screened:
    """A candidate by the linear model about a robot without it."""
    channels = len(candidate.channels)
    with_it = join_law(likelihood.robot.machine, base, candidate, np.ones(channels), MODES)
    moved = with_it.at_each(likelihood, [np.r_[base.x, unit] for unit in np.eye(MODES * channels)])
    directions = np.array([e.residual for e in moved]) - base.residual
    columns, memory = whole_jacobian(likelihood, base), likelihood.memory
    model = LinearModel.with_directions(base, columns, directions, likelihood.blocks, memory)
    reduced = model.eliminate(len(base.x))
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
    law = candidate.law.identity
    at = {name: np.array([*machine.effect_indices(law, name).values()]) for name in ("form", *KNOTS, *WEIGHTS)}
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


def draw_curves(fit: LawFit, weights: np.ndarray, counts: np.ndarray) -> dict[str, Curve]:
    """The law in each channel with its 90 % band; weights (channels, 8), histogram `counts` (channels, bins) of u."""
    candidate, model, found = fit.candidate, fit.model, {}
    samples, own = float(model.effective.sum()), fit.modes[fit.active].ravel()
    short = find_formulas(candidate, fit.active, model.eliminate(fit.beside), own, fit.scales[fit.active], samples)
    at, shape = candidate.shape()
    covariance = model.posterior().covariance[fit.beside :, fit.beside :]
    for i, channel in enumerate(fit.active):
        place = slice(i * SIZE, (i + 1) * SIZE)
        to_values = shape[channel] @ (candidate.size[channel] * candidate.basis)
        half = NORMAL_90 * np.sqrt(np.einsum("ij,jk,ik->i", to_values, covariance[place, place], to_values))
        value, name = shape[channel] @ weights[channel], candidate.channels[channel]
        edges = np.linspace(candidate.low[channel], candidate.high[channel], counts.shape[1] + 1)
        share = counts[channel] / max(float(counts[channel].sum()), 1.0)
        found[name] = Curve(at[channel], value, value - half, value + half, edges, share, short.get(name, ""))
    return found
