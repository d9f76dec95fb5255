"""Discovery of the free law, among all points of all parts, that best explains the gap beside the effects of a case.

One linear model about the best set screens all laws, the best few are fitted through the simulation and compared by
their evidence: docs/explain/missing_law.md.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from exodrake.core.confidence import ALPHA, NORMAL_90
from exodrake.core.parallel import side_by_side
from exodrake.core.plain import plain
from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.diagnosis.closure import change_robot, measure
from exodrake.diagnosis.discovery import law_code
from exodrake.diagnosis.discovery.law_code import KNOTS, SEEN, SIZE, WEIGHTS, LawPoint
from exodrake.diagnosis.fit import Explanation, linear_model, minimise, settle, whole_jacobian, without
from exodrake.diagnosis.isolation import Isolation
from exodrake.diagnosis.likelihood import SAMPLE, Likelihood
from exodrake.diagnosis.linear import RIDGE, LinearModel
from exodrake.diagnosis.parameter import Parameter
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import Interval
from exodrake.diagnosis.search import LAW, NATS
from exodrake.diagnosis.verdict import LARGE, MOST
from exodrake.model.display import percent
from exodrake.model.machine import Machine, stack, state_size
from exodrake.model.part import HYSTERESIS, READINGS, RELAXATION, FreeLaw
from exodrake.model.robot import Robot

LENGTH = 0.4  # correlation length of a curve in its range: assumed
FINE = 40.0  # range over the width near 0 in which knots lie close: assumed
REACHES = (0.01, 0.6)  # of hysteresis, smallest and largest in ranges of the variable: assumed
MODEST = 0.05  # size of a law in the range of its point's value: small against curvature, large against rounding
FRAMES = 2.0  # shortest memory
SCALES = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)  # of a law in units of its plausible size
MODES, PASSES = 3, 2  # of a law with which it is screened; over the channels in search of their scales
STARTED, PER_POINT = 14, 4  # laws that are simulated as predicted, and at most at one point
FITTED, OTHERS = 3, 1  # laws that are fitted, inside a block and outside it
SHARES = (1.0, 0.5, 0.2, 0.05)  # of a predicted law, tried where its fit begins
ROUNDS = 2  # fits of the best law on whole logs, each with new Jacobians of the other parameters
# in 90 % of robots a law in a wrong part takes up less of what the best one in the right part leaves: conformal
# quantile of 24 of the reference simulator, rounded up (docs/missing_law.md); the largest are 0.65, 0.49 and 0.05
LEAD = 0.5
TERMS = 3  # of a formula
GRID = 200  # points on which a term is approximated by a curve
WIDTHS = (0.02, 0.05, 0.1, 0.14, 0.2, 0.28, 0.4)  # of terms with a width, in the largest |u|
BENDS = (0.2, 0.35, 0.5, 0.65, 0.8)  # of terms with a bend, in the range of u


@dataclass(frozen=True, eq=False)
class Candidate:
    """A candidate for the missing law: a form at a point."""

    law: LawPoint
    number: int  # of the form, from 1
    channels: tuple[str, ...]
    knots: np.ndarray  # (channels, 8) of the curve, reaches of hysteresis [unit of u] or time constants [s]
    size: np.ndarray  # (channels,) plausible weight
    basis: np.ndarray  # (8, 8) weights of the modes in units of size, largest prior variance first
    low: np.ndarray  # (channels,) lowest value of its variable in the simulated logs [unit of u]
    high: np.ndarray  # (channels,) highest value [unit of u]

    @property
    def form(self) -> FreeLaw:
        """Its form."""
        return self.law.forms[self.number - 1]

    @property
    def name(self) -> str:
        """Id of the effect and its form in words."""
        return f"{self.law.learned}: {self.form.words}"


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
    # of the excess over noise that what it stands beside leaves on the fitted logs, removed by it (`LawFit.share`)
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
    """A law beside the parameters of an explanation, as the linear model predicts it or fitted through simulation."""

    candidate: Candidate
    scales: np.ndarray  # (channels,) prior standard deviations of its modes; 0 where it is absent
    explanation: Explanation  # coordinates of the law's modes are the last ones
    base: Explanation  # without the law
    likelihood: Likelihood  # views of the case that were fitted
    gain: float = 0.0  # of log evidence by the linear model [nats]

    @property
    def is_memory(self) -> bool:
        """Whether the law is the memory of a reading."""
        return self.candidate.form.kind in (HYSTERESIS, RELAXATION) and self.candidate.law.point.name in READINGS

    @cached_property
    def share(self) -> float:
        """Share of the excess over noise that the law removes, the mean of the views with a gap that counts."""
        before, left = (np.maximum(self.likelihood.chi2(e.residual) - 1.0, 0.0) for e in (self.base, self.explanation))
        wide = before > self.likelihood.views[0].problem.negligible ** 2
        return float(np.mean(1.0 - left[wide] / before[wide])) if wide.any() else 0.0

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
        """Weights (channels, 8) of the law."""
        return self.candidate.size[:, None] * (self.modes @ self.candidate.basis.T)

    @cached_property
    def model(self) -> LinearModel:
        """The linear model about the fit."""
        memory = self.likelihood.with_memory(self.explanation.residual)
        return linear_model(memory.scaled_to(self.explanation.residual), self.explanation)


def measure_lead(share: float, other: float) -> float:
    """Share of what another law leaves that a law takes up, by the shares of the excess that both remove.

    Below 0 a fit ended early: with no law at all it is 0.
    """
    return 1.0 - (1.0 - share) / max(1.0 - max(other, 0.0), 1e-9)


def discover(found: Isolation, progress: StageProgress = no_progress, blocks: Collection[str] = ()) -> MissingLaw:
    """The law that is missing in a case: the most likely one at any point.

    Laws are sought beside the retuned robot, and beside the best set of effects where that explains half of the gap.

    blocks: of the robot whose points are tried; all where empty.
    """
    accepted = found.best if 1.0 - found.search.measure_left(found.best) >= MOST else found.retuned
    if found.excess(accepted.explanation.robot) < 0.0:
        who = accepted.explanation.name if accepted.effects else "retuning"
        return MissingLaw(False, f"what {who} leaves is negligible: no law is missing")
    progress(Stage.LINEARISE, "free laws")
    bare, case = found.whole.robot.machine, found.whole.case.name
    machine = law_code.add_laws(bare)
    laws = [law for law in law_code.law_points(bare) if not blocks or law.block in blocks]
    part, whole = (replace(p, robot=law_code.robot_on(p.robot, machine)) for p in (found.problem, found.whole))
    index = [machine.index[p.name] for p in bare.parameters]
    likelihood = found.likelihood.on(part).for_stage("discover")
    likelihood = replace(likelihood, memory=min(likelihood.memory, max(SAMPLE / machine.frame, 1.0)))
    fits, tried = list[LawFit](), dict[str, int]()
    for e in {id(f): f.explanation for f in (accepted, found.retuned)}.values():
        parameters = tuple(replace(p, index=tuple(index[i] for i in p.index)) for p in e.parameters)
        base = replace(e, parameters=parameters, values=law_code.values_on(e.values, bare, machine))
        scaled, candidates = likelihood.scaled_to(e.residual), list_candidates(whole, base.robot, laws)
        tried[base.name] = len(candidates)
        fits += fit_best(side_by_side([partial(screen, scaled, base, candidate) for candidate in candidates]), progress)
    if not fits:
        return MissingLaw(False, "the logs are as likely without any law as with one", p_noise=1.0)
    memory = min(fit.model.memory for fit in fits)
    fits.sort(key=lambda fit: -fit.model.evidence(memory))
    base, likelihood = fits[0].base, fits[0].likelihood
    fits = [fit for fit in fits if fit.base is base]
    # the memory of a reading imitates any cause: a law that removes as much, but for errors of laws, goes before it
    causes = [fit for fit in fits if not fit.is_memory and fit.share >= (1.0 - LAW) * fits[0].share]
    if fits[0].is_memory and causes:
        fits.sort(key=lambda fit: fit is not causes[0])
    others = tuple(Runner(f.candidate.law.learned, f.candidate.form.words, f.share) for f in fits)
    best, share, memory, rest = fits[0], fits[0].share, fits[0].model.memory, base.name if base.effects else "retuning"
    gain = best.model.evidence(memory) - linear_model(likelihood, base).evidence(memory)
    # evidence exceeds exp(g) times that of no law with probability exp(-g) at most (Markov); any of those tried may
    p = float(min(1.0, tried[base.name] * len(SCALES) * np.exp(-gain)))
    if p > ALPHA or share < LARGE:
        weak = f"the best law, {best.candidate.name}, removes only {percent(share)} of what {rest} leaves"
        reason = f"no law takes up more than noise lets one (p = {p:.2g})" if p > ALPHA else weak
        return MissingLaw(False, reason, p_noise=p, others=others)
    progress(Stage.CLOSURE, best.candidate.name)
    for effect in best.explanation.effects:  # without those that no longer earn their place beside it
        start = without(best.likelihood, best.explanation, effect)
        trial = replace(best, explanation=minimise(best.likelihood.scaled_to(start.residual), start))
        if best.model.evidence(best.model.memory) - trial.model.evidence(best.model.memory) < NATS:
            best = trial
    on_whole = best.likelihood.on(whole)
    e = best.explanation.at(on_whole, best.explanation.x)
    e = replace(e, jacobian=np.zeros((e.nominal, len(e.residual)), dtype=np.float32))
    for _ in range(ROUNDS):
        e = settle(on_whole, e, np.ones(e.nominal, dtype=bool))
    best = replace(best, explanation=e, likelihood=on_whole)
    candidate, robot, weights = best.candidate, best.explanation.robot, best.weights
    rival = next((one for one in others if one.id.split(".")[0] != candidate.law.block), None)
    lead = 1.0 if rival is None else measure_lead(share, rival.share)
    watched = {"form": float(candidate.number), "low": candidate.low, "high": candidate.high}
    states = run_watches(whole, base.robot, {candidate.law.identity: watched})[candidate.law.identity]
    curves = draw_curves(best, np.array([states[c].sum(axis=0) for c in law_code.COUNTS]).T)
    short = {name: curve.formula for name, curve in curves.items() if curve.formula}
    strongest = int(abs(weights).max(axis=1).argmax())
    at = candidate.knots[strongest], weights[strongest]
    text = law_code.effect_text(candidate.law, candidate.form, *at, case, short)
    rows = np.array([law_code.values_on(found.whole.silent(), bare, machine), base.robot, robot])
    known = change_robot(found.whole, robot[index], case)
    words, key = candidate.form.words, candidate.law.key
    return MissingLaw(
        found=True, reason=f"a free law of {words} at {key} removes {percent(share)} of what {rest} leaves",
        id=others[0].id, words=words, unit=candidate.form.unit,
        channels=tuple(name for name in (candidate.channels[i] for i in best.active) if name),
        share=share, p_noise=p, runner_up=rival, lead=lead,
        distinguished=lead > LEAD, others=others, curves=curves,
        closure=measure(whole, [rows] * len(whole.judged)).effect, held_out=bool(whole.holdout),
        robot=law_code.robot_with(known, text, candidate.channels, candidate.knots, weights), text=text,
    )  # fmt: skip


def run_watches(
    problem: Problem, values: np.ndarray, settings: Mapping[str, Mapping[str, float | np.ndarray]]
) -> dict[str, dict[str, np.ndarray]]:
    """States of watches, effects that count, at the ends of all fitted trials, run in closed loop without noise.

    values: (parameters,) of the robot. settings: id of each law to be watched -> parameters of its watch. Returns the
    same id -> name of a state -> (trials, channels).
    """
    machine, row = problem.robot.machine, values.copy()
    for identity, given in settings.items():
        for name, value in given.items():
            row[[*machine.effect_indices(f"{identity}_watch", name).values()]] = value

    ends = np.zeros((len(problem.fit), 1, state_size(machine)))
    side_by_side([partial(problem.records, row[None], t, ends=end) for t, end in zip(problem.fit, ends, strict=True)])
    widths = {
        (owner, s.name): machine.width(s.axis) * s.width
        for part in machine.parts
        for owner, states in ((part.name, part.states), *((e.id, e.states) for e in machine.effects_on(part)))
        for s in states
    }
    places = stack(widths)
    return {law: {name: ends[:, 0, places[f"{law}_watch", name]] for name in SEEN} for law in settings}


def list_candidates(problem: Problem, values: np.ndarray, laws: Sequence[LawPoint]) -> list[Candidate]:
    """All laws that may be missing at some points, where a robot `values` (parameters,) with watches runs a case."""
    machine, found = problem.robot.machine, list[Candidate]()
    longest = max(len(trial.reference) for trial in problem.fit) * machine.frame
    # of the variable of each form that is computed (channels,)
    ranges: dict[tuple[str, int], tuple[np.ndarray, np.ndarray]] = {}
    for k in range(1, max((len(law.forms) for law in laws), default=-1) + 2):  # each form, and the law's scale
        settings = {law.identity: {"form": float(k)} for law in laws if k <= len(law.forms) + 1}
        for identity, states in run_watches(problem, values, settings).items():
            if states["started"].any():
                low, high = states["low_seen"].min(axis=0), states["high_seen"].max(axis=0)
                ranges[identity, k] = low, np.where(high > low, high, low + 1e-9)
    for law, k, form in ((one, k, form) for one in laws for k, form in enumerate(one.forms, 1)):
        if not {(law.identity, k), (law.identity, len(law.forms) + 1)} <= set(ranges):
            continue
        (low, high), (least, most) = ranges[law.identity, k], ranges[law.identity, len(law.forms) + 1]
        # plausible weights: the range of the value that passes, over that of the factor
        size = np.maximum(most - least, 0.5 * np.maximum(abs(least), abs(most)))
        size = np.maximum(size, 0.1 * max(float(size.max()), 1e-6))
        least_span = 1e-6 * np.maximum(1.0, abs(low))
        if np.all(high - low <= least_span):
            continue  # a law of what stays as it is would be a number
        span = np.maximum(high - low, least_span)
        if form.kind == RELAXATION:
            knots = np.tile(np.geomspace(FRAMES * machine.frame, 0.5 * longest, SIZE), (len(low), 1))
            size = size / np.maximum(high - low, 1e-9)
        elif form.kind == HYSTERESIS:
            knots = span[:, None] * np.geomspace(*REACHES, SIZE)
        elif form.fine:
            near = span / FINE
            knots = (near * np.sinh(np.linspace(np.arcsinh(low / near), np.arcsinh((low + span) / near), SIZE))).T
        else:
            knots = np.linspace(low, low + span, SIZE).T
        if form.kind != RELAXATION and form.factor.isidentifier():
            size = np.ones(len(size))
        # modes of the prior of the weights: smooth curves (a Gaussian process), or independent elements
        basis = np.eye(SIZE)[:, [1, 3, 5, 7, 0, 2, 4, 6]]
        if form.is_curve:
            apart = np.sqrt(3.0) * abs(np.subtract.outer(np.arange(SIZE), np.arange(SIZE))) / (SIZE - 1) / LENGTH
            variances, vectors = np.linalg.eigh(1.0 + (1.0 + apart) * np.exp(-apart))  # a constant, and Matern 3/2
            basis = (vectors * np.sqrt(variances))[:, ::-1]
        found.append(Candidate(law, k, machine.axes.of(law.point.axis), knots, MODEST * size, basis, low, high))
    return found


def screen(likelihood: Likelihood, base: Explanation, candidate: Candidate) -> LawFit:
    """A candidate by the linear model about a robot without it."""
    machine, channels = likelihood.robot.machine, len(candidate.channels)
    with_it = join_law(machine, base, candidate, np.ones(channels), MODES)
    moved = with_it.at_each(likelihood, [np.r_[base.x, unit] for unit in np.eye(MODES * channels)])
    directions = np.array([e.residual for e in moved]) - base.residual
    columns, memory = whole_jacobian(likelihood, base), likelihood.memory
    model = LinearModel.with_directions(base, columns, directions, likelihood.blocks, memory)
    reduced = model.eliminate(len(base.x))
    scales, found, gain = weigh_scales(reduced.normal, reduced.slope, np.repeat(np.arange(channels), MODES))
    modes = np.zeros((channels, SIZE))
    modes[:, :MODES] = found.reshape(channels, MODES)
    x = np.r_[base.x + reduced.others(np.arange(len(found)), found), modes[scales > 0.0].ravel()]
    return LawFit(candidate, scales, replace(join_law(machine, base, candidate, scales), x=x), base, likelihood, gain)


def weigh_scales(normal: np.ndarray, slope: np.ndarray, channel: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Prior scales (channels,) of largest evidence, coordinates (n,) with them, and the log evidence beyond none.

    Of a cost c's + c'Nc / 2 of coordinates c of some channels (n,), others eliminated: N (n, n), s (n,). A channel that
    the logs do not need gets 0 (MacKay, Neural Computation 4(3), 1992).
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
            parameters.append(Parameter(name, index, "along", 0.0, std, (-np.inf, np.inf), "", (channel,), along=along))
    x = np.r_[base.x, np.zeros(len(parameters) - len(base.x))]
    return Explanation(base.effects, tuple(parameters), x, values, base.residual, base.jacobian)


def fit_best(screened: Sequence[LawFit], progress: StageProgress) -> list[LawFit]:
    """The most promising laws fitted, in the block of the best one and outside it."""

    def start(law: LawFit) -> LawFit:
        """A screened law simulated with as much of its predicted weights as fits best."""
        e, known = law.explanation, law.base.x
        none = np.r_[known, np.zeros(len(e.x) - len(known))]
        tried = e.at_each(law.likelihood, [none + share * (e.x - none) for share in SHARES])
        return replace(law, explanation=min((replace(e, x=none), *tried), key=lambda one: one.cost(law.likelihood)))

    def fit_law(begun: LawFit) -> LawFit:
        """A law fitted, its scales those of the largest evidence about a first fit."""
        likelihood = begun.likelihood
        first = minimise(likelihood.scaled_to(begun.explanation.residual), begun.explanation, 2)
        fit = replace(begun, explanation=settle(likelihood, first))
        reduced = replace(fit.model, memory=likelihood.memory).eliminate(fit.beside)
        slope = reduced.slope - reduced.normal @ fit.explanation.x[fit.beside :]
        scales = np.zeros(len(fit.scales))
        scales[fit.active] = weigh_scales(reduced.normal, slope, np.repeat(np.arange(len(fit.active)), SIZE))[0]
        if not scales.any():
            return fit
        e = join_law(likelihood.robot.machine, fit.base, fit.candidate, scales)
        x = np.r_[fit.explanation.x[: fit.beside], fit.modes[scales > 0.0].ravel()]
        e = replace(e, jacobian=fit.explanation.jacobian).at(likelihood, x)
        return replace(fit, scales=scales, explanation=minimise(likelihood.scaled_to(e.residual), e))

    chosen: list[LawFit] = []
    for law in sorted((law for law in screened if law.scales.any()), key=lambda law: -law.gain):
        if sum(c.candidate.law is law.candidate.law for c in chosen) < PER_POINT and len(chosen) < STARTED:
            chosen.append(law)
    starts = side_by_side([partial(start, law) for law in chosen])
    starts.sort(key=lambda law: law.explanation.cost(law.likelihood))
    blocks = [law.candidate.law.block for law in starts]
    inside, outside = ([f for f, b in zip(starts, blocks) if (b == blocks[0]) is here] for here in (True, False))
    wanted = [*inside[:FITTED], *outside[:OTHERS]]
    progress(Stage.FIT, ", ".join(dict.fromkeys(f.candidate.law.learned for f in wanted)))
    return side_by_side([partial(fit_law, f) for f in wanted])


def draw_curves(fit: LawFit, counts: np.ndarray) -> dict[str, Curve]:
    """The law in each channel with its 90 % band, and the histogram `counts` (channels, bins) of u."""
    candidate, short, found = fit.candidate, find_formulas(fit), {}
    # a curve at its knots; hysteresis as the first loading from rest; relaxation as the answer to a step
    at, shape = candidate.knots, np.tile(np.eye(SIZE), (len(candidate.knots), 1, 1))
    if not candidate.form.is_curve:
        at = np.concatenate([np.zeros((len(at), 1)), at], axis=1)
        ratio = at[:, :, None] / candidate.knots[:, None, :]
        shape = np.minimum(ratio, 1.0) if candidate.form.kind == HYSTERESIS else np.exp(-ratio)
    covariance = fit.model.posterior().covariance[fit.beside :, fit.beside :]
    for i, channel in enumerate(fit.active):
        place = slice(i * SIZE, (i + 1) * SIZE)
        to_values = shape[channel] @ (candidate.size[channel] * candidate.basis)
        half = NORMAL_90 * np.sqrt(np.einsum("ij,jk,ik->i", to_values, covariance[place, place], to_values))
        value, name = shape[channel] @ fit.weights[channel], candidate.channels[channel]
        edges = np.linspace(candidate.low[channel], candidate.high[channel], counts.shape[1] + 1)
        share = counts[channel] / max(float(counts[channel].sum()), 1.0)
        found[name] = Curve(at[channel], value, value - half, value + half, edges, share, short.get(name, ""))
    return found


def find_terms(candidate: Candidate) -> Iterator[tuple[str, np.ndarray]]:
    """Named terms that a law may be made of: text with u, and values (channels, 8) at the knots, or of the elements."""
    form, u = candidate.form, candidate.knots
    if not form.is_curve:
        word, unit = ("stop", form.unit) if form.kind == HYSTERESIS else ("fading", "s")
        for i in range(SIZE):
            yield f"{word}(u; {float(np.median(u[:, i])):.2g} {unit})", np.tile(np.eye(SIZE)[i], (len(u), 1))
        return
    low, high = float(u.min()), float(u.max())
    largest = max(abs(low), abs(high))
    signed = low < -0.05 * largest
    terms: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "1": np.ones_like, "u": lambda u: u, "u^2": lambda u: u**2, "u^3": lambda u: u**3,
    }  # fmt: skip
    if signed:
        terms |= {"sign(u)": np.sign, "|u|": abs, "u |u|": lambda u: u * abs(u)}
    for c in (w * largest for w in WIDTHS):
        name = f"exp(-|u| / {c:.2g}) sign(u)" if signed else f"exp(-u / {c:.2g})"
        terms[name] = lambda u, c=c: np.exp(-abs(u) / c) * np.sign(u) if signed else np.exp(-u / c)
        terms[f"tanh(u / {c:.2g})"] = lambda u, c=c: np.tanh(u / c)
        terms[f"sin(u / {c:.2g})"] = lambda u, c=c: np.sin(u / c)
    for c in (low + b * (high - low) for b in BENDS):
        terms[f"max(0, u - {c:.2g})"] = lambda u, c=c: np.maximum(0.0, u - c)
        terms[f"max(0, {c:.2g} - u)"] = lambda u, c=c: np.maximum(0.0, c - u)
    for text, function in terms.items():
        curves = []
        for knots in u:  # the curve that is nearest to the function over the range of the knots
            at = np.linspace(knots[0], knots[-1], GRID)
            hats = np.array([np.interp(at, knots, one) for one in np.eye(SIZE)]).T
            curves.append(np.linalg.lstsq(hats, np.broadcast_to(function(at), at.shape), rcond=None)[0])
        yield text, np.array(curves)


def find_formulas(fit: LawFit) -> dict[str, str]:
    """The shortest formula that is as likely as a fitted free law, by channel; none without one.

    Terms are selected greedily by the Bayesian information criterion.
    """
    candidate, active, reduced = fit.candidate, fit.active, fit.model.eliminate(fit.beside)
    modes, prior = fit.modes[active].ravel(), np.repeat(fit.scales[active], SIZE)
    penalty, back = float(np.log(fit.model.effective.sum())), np.linalg.inv(candidate.basis)
    volume = np.linalg.slogdet(np.eye(len(prior)) + reduced.normal * np.outer(prior, prior))[1]
    free, (texts, shapes) = float(np.sum((modes / prior) ** 2) + volume), zip(*find_terms(candidate), strict=True)
    # coordinates of each term in one active channel each (active, n)
    known = [np.asarray(block_diag(*(back @ shape[c] / candidate.size[c] for c in active))) for shape in shapes]

    def solve(terms: list[int]) -> tuple[float, np.ndarray]:
        """Cost beyond that of the fit, and coefficients (terms of each active channel,)."""
        t = np.concatenate([known[term] for term in terms]).T if terms else np.zeros((len(modes), 0))
        normal, slope = t.T @ reduced.normal @ t, t.T @ (reduced.slope - reduced.normal @ modes)
        b = -np.linalg.solve(normal + np.diag(RIDGE * np.diag(normal) + 1e-12), slope)
        step = t @ b - modes
        return float(2.0 * reduced.slope @ step + step @ reduced.normal @ step) + penalty * len(b), b

    chosen: list[int] = []
    while len(chosen) < TERMS and solve(chosen)[0] > free:
        trial = min(set(range(len(known))) - set(chosen), key=lambda term: solve([*chosen, term])[0])
        if solve([*chosen, trial])[0] >= solve(chosen)[0]:
            break
        chosen.append(trial)
    if not chosen or solve(chosen)[0] > free:
        return {}
    for term in chosen[:-1]:  # that a later one made needless
        less = [one for one in chosen if one != term]
        chosen = less if solve(less)[0] < solve(chosen)[0] else chosen
    found, table = {}, solve(chosen)[1].reshape(len(chosen), len(active))
    named = ["" if texts[term] == "1" else f" {texts[term]}" for term in chosen]
    for channel, factors in zip(active, table.T, strict=True):
        parts = [f" {'-' if b < 0.0 else '+'} {abs(b):.3g}{n}" for b, n in zip(factors, named, strict=True)]
        found[candidate.channels[channel]] = f"f(u) ={''.join(parts).removeprefix(' +')}"
    return found
