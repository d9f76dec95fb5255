"""Rival explanations of a case, and what a motion tells about them (T-optimality; Atkinson & Fedorov 1975).

T, what a refitted rival leaves if another explanation is true, is that of the linear model of `diagnosis.linear`; its
products add over motions. The equations are in docs/howto/experiment.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial, reduce
from itertools import combinations, permutations
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.stats import norm

from exodrake.core.errors import InputError
from exodrake.core.progress import StageProgress, no_progress
from exodrake.core.schema import having, listing, names, number, read_json, text
from exodrake.data.case import read_case
from exodrake.diagnosis import pipeline
from exodrake.diagnosis.detect import detect
from exodrake.diagnosis.fit import Explanation, linear_model, minimise, whole_jacobian, without
from exodrake.diagnosis.isolation import USED, affordable
from exodrake.diagnosis.likelihood import Likelihood, make_likelihood
from exodrake.diagnosis.linear import LinearModel
from exodrake.diagnosis.linearise import nominal_jacobian, with_effects
from exodrake.diagnosis.many import ANSWER
from exodrake.diagnosis.parameter import effect_parameters, nominal_parameters
from exodrake.diagnosis.problem import Problem, Trial, list_required, make_problem
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, RETUNE, Rival, record_provenance
from exodrake.diagnosis.search import LAW, NATS
from exodrake.engine.inputs import Reference
from exodrake.model.robot import Robot

DRAWS = 8  # plausible robots of an explanation: assumed
UNSURE = 0.25  # relative standard deviation of the error of a law in a new motion: assumed
STEPS = 3  # of a refit that is carried on
RIVALS = listing(having({"effects": listing(text()), "parameters": names(number())}, ("effects", "parameters")))
MADE_FROM = having({"files": names(text()), "parameters": text()}, ("files", "parameters"))
SCHEMA = having({"verdict": text(), "rivals": RIVALS, "provenance": MADE_FROM}, ("verdict", "rivals", "provenance"))
NOTHING = {
    NO_GAP: "its logs show no gap",
    RETUNE: "retuning closes its gap, and no single effect does so as well",
    **dict.fromkeys((NAMED, AMBIGUOUS), "one explanation is left"),
}
NONE_LEFT = (
    "no explanation is left to tell apart; repeat the motion slowly, then quickly, and see what the error follows"
)


def read_rivals(
    place: Path, robot: Robot, folder: Path | None = None, progress: StageProgress = no_progress
) -> tuple[Problem, tuple[Rival, ...], str]:
    """A case, its rivals, which the logs do not tell apart, and why there are none, in words, empty where there are.

    `place` is a folder of logs or one log, whose `diagnosis.json` is used if it was made from them and of this robot;
    or an answer, a JSON file, whose case may be another `folder`. InputError for what cannot be read, and an answer to
    other logs or of another robot.
    """
    machine, is_answer = robot.machine, place.suffix.lower() == ".json" and not place.is_dir()
    if folder is not None and not is_answer:
        raise InputError(f"--case {folder}: for an answer (a JSON file); {place} is a case itself")
    stored = place if is_answer else place / ANSWER
    try:
        answer = SCHEMA(read_json(stored), str(stored))
    except InputError:
        if is_answer:
            raise
        answer = None
    case = read_case((folder or place.parent) if is_answer else place, list_required(machine), machine.frame)
    problem = make_problem(case, robot)
    if answer is not None:
        ours, theirs = record_provenance(problem), answer["provenance"]
        differs = "another nominal robot" if theirs["parameters"] != ours.parameters else ""
        differs = f"other logs than those of {case.name}" if theirs["files"] != ours.files else differs
        if differs and is_answer:
            raise InputError(f"{place}: it was made from {differs}; diagnose again")
        answer = None if differs else answer
    if answer is None:
        found = pipeline.diagnose(case, robot, progress)
        verdict, rivals = found.verdict, found.rivals
    else:
        verdict = answer["verdict"]
        rivals = tuple(Rival(tuple(r["effects"]), r["parameters"]) for r in answer["rivals"])
    reason = f"{verdict}, {NOTHING.get(verdict, NONE_LEFT)}: there is nothing for an experiment to distinguish"
    return problem, rivals, "" if len(rivals) > 1 else f"{case.name}: {reason}"


@dataclass(frozen=True, eq=False)
class Contest:
    """A case and the explanations still in play, fitted to the part of the logs that a diagnosis uses."""

    problem: Problem  # the case in full length
    likelihood: Likelihood  # its closed-loop view alone, of that part
    explanations: tuple[Explanation, ...]
    robots: np.ndarray  # (explanations, parameters) flat parameter vectors [SI]
    bare: np.ndarray  # the same without their effects
    spreads: tuple[np.ndarray, ...]  # (parameters, parameters) V of each
    chi2: np.ndarray  # (explanations,) reduced chi-squares, 1 at least
    taken: np.ndarray  # (explanations,) G, squares that effects take up of the present logs beside retuning
    own: np.ndarray  # (explanations,) share of their contribution that this is
    error: np.ndarray  # (explanations,) relative error of the laws: that shown by what each leaves, `LAW` at most

    def records(self, reference: Reference) -> np.ndarray:
        """All signals (explanations, frames, signals) [SI] of the runs of the explanations on a reference."""
        return self.problem.records(self.robots, Trial(reference.name, reference.values, np.zeros((0, 0))))

    def difference(self, records: np.ndarray) -> float:
        """Difference in the logged columns between the two most similar runs of `records`, for a first ranking.

        The mean over frames of log(1 + d), d the mean square difference [noise_std^2]: a snap is a few frames.
        """
        logs = records[:, :, self.problem.signal_indices] / self.problem.noise_std
        return min(float(np.mean(np.log1p(np.mean((a - b) ** 2, axis=1)))) for a, b in combinations(logs, 2))

    def trial(self, true: int, reference: np.ndarray) -> Trial:
        """A log (frames, columns) that an explanation would leave on a reference (frames, references) [SI]."""
        empty = Trial("experiment", reference, np.zeros((len(reference), len(self.problem.columns))))
        return replace(empty, measured=self.problem.predict(self.robots[true][None], empty)[0])

    def view(self, *trials: Trial, scale: float = 1.0) -> Likelihood:
        """The likelihood of some logs, whitened as those of the case."""
        problem = replace(self.problem, fit=trials)
        return replace(self.likelihood, views=(replace(self.likelihood.views[0], problem=problem, scale=scale),))


def prepare_contest(problem: Problem, rivals: Sequence[Rival]) -> Contest:
    """The contest of a case and two or more explanations with their fitted parameters.

    InputError for a rival with an effect or a parameter that the machine does not have.
    """
    machine, nominal, rows = problem.robot.machine, problem.silent(), []
    for rival in rivals:
        if unknown := next((name for name in rival.parameters if name not in machine.index), None):
            raise InputError(f"{rival.name}: {machine.name} has no parameter {unknown!r}; answered with another robot?")
        rows.append(nominal.copy())
        rows[-1][[machine.index[name] for name in rival.parameters]] = [*rival.parameters.values()]
    effects = [[machine.effect(identity) for identity in rival.effects] for rival in rivals]
    problem = detect(problem, rows[0])
    likelihood = make_likelihood(problem.shorten(affordable(problem, USED)), rows[0])
    likelihood, found = replace(likelihood, views=likelihood.views[:1]), list[Explanation]()
    own = tuple(replace(p, base=float(nominal[p.index[0]])) for p in nominal_parameters(problem.robot))
    for rival, row, laws in zip(rivals, rows, effects, strict=True):
        parameters = (*own, *(p for effect in laws for p in effect_parameters(problem.robot, effect)))
        x = np.array([p.coordinate(float(row[p.index[0]])) for p in parameters])
        values = with_effects(problem.silent(), machine, laws)
        none = np.zeros((len(own), 0))
        found.append(differentiate(likelihood, Explanation(rival.effects, parameters, x, values, none, none), x))
    memory = min(likelihood.with_memory(e.residual).memory for e in found)
    likelihood, models, whole, rest = replace(likelihood, memory=memory), [], [], []
    bare = [reduce(partial(without, likelihood), e.effects, e) for e in found]
    for e, retuned in zip(found, bare, strict=True):
        models.append(linear_model(likelihood, e))
        change = retuned.residual - e.residual
        model = pair_model(change, e.jacobian * e.prior_std[: e.nominal, None], np.full(len(change), 1.0 / memory))
        both = np.r_[model.posterior().step, 1.0]
        rest.append(memory * float(both @ model.products[0] @ both))  # that retuning does not take up
        whole.append(float(change @ change))
    chi2 = np.array([model.variance[0] for model in models])
    left = np.maximum(chi2 - 1.0, 0.0) * likelihood.samples / np.maximum(rest, 1e-9)
    return Contest(
        problem, likelihood, tuple(found), robots=np.array([e.robot for e in found]),
        bare=np.array([e.robot for e in bare]), chi2=chi2,
        spreads=tuple(np.linalg.cholesky(model.posterior().covariance) for model in models),
        taken=np.array(rest) / (memory * chi2), own=np.array(rest) / np.maximum(whole, 1e-9),
        error=np.minimum(np.sqrt(left), LAW),
    )  # fmt: skip


def differentiate(likelihood: Likelihood, e: Explanation, x: np.ndarray) -> Explanation:
    """An explanation at coordinates x (parameters,) on the logs of a likelihood, with its Jacobian there."""
    e = e.at(likelihood, x)
    return replace(e, jacobian=nominal_jacobian(likelihood, e))


def pair_model(difference: np.ndarray, columns: np.ndarray, weights: np.ndarray) -> LinearModel:
    """The linear model of a refit: difference (samples,), derivatives (directions, samples), W (samples,)."""
    rows, flat = np.vstack([columns, difference]) * np.sqrt(weights), np.zeros(len(columns))
    model = LinearModel.of_rows(rows, [(0, 0, slice(None))], (flat, flat + 1.0, flat - np.inf, flat + np.inf), 1.0)
    return replace(model, variance=np.ones(1))


@dataclass(frozen=True, eq=False)
class Information:
    """Expected information of a motion about the rival explanations."""

    models: dict[tuple[int, int], LinearModel]  # (true, rival) -> linear model of the refit
    taken: np.ndarray  # (explanations,) G of each, of the present logs and these
    contest: Contest
    # (true, rival) -> T and coordinates (parameters,) of a refit that was carried to its end (`refit`)
    ended: dict[tuple[int, int], tuple[float, np.ndarray]] = field(default_factory=dict)

    def __add__(self, other: Information) -> Information:
        models = {k: replace(m, products=m.products + other.models[k].products) for k, m in self.models.items()}
        return Information(models, self.taken + other.taken - self.contest.taken, self.contest)

    @property
    def left(self) -> dict[tuple[int, int], float]:
        """(true, rival) -> T, the sum of squares that the refitted rival leaves."""
        linear = {key: model.posterior().cost for key, model in self.models.items()}
        return {key: min(t, self.ended[key][0]) if key in self.ended else t for key, t in linear.items()}

    def refit(self, true: int, rival: int) -> np.ndarray:
        """Coordinates (parameters,) of a refitted rival."""
        if (true, rival) in self.ended:
            return self.ended[true, rival][1]
        e, step = self.contest.explanations[rival], self.models[true, rival].posterior().step
        return np.clip(e.x + self.contest.spreads[rival] @ step, *e.bounds)

    @cached_property
    def beyond(self) -> dict[tuple[int, int], float]:
        """(true, rival) -> excess of sqrt T over sqrt T* in standard deviations."""
        laws = self.contest.error * np.sqrt(self.taken)
        least, std = np.maximum(np.sqrt(2.0 * NATS), laws), np.hypot(1.0, UNSURE * laws)
        return {key: float((np.sqrt(t) - least[key[0]]) / std[key[0]]) for key, t in self.left.items()}

    @property
    def criterion(self) -> tuple[float, float]:
        """Objective of the search: logarithm of the product of all probabilities, then the least `beyond`."""
        return float(np.sum(norm.logcdf([*self.beyond.values()]))), min(self.beyond.values())

    @property
    def closest(self) -> tuple[int, int]:
        """The (true, rival) of least `beyond`."""
        return min(self.beyond, key=self.beyond.__getitem__)

    def power(self, true: int, rival: int) -> float:
        """Probability that an experiment distinguishes a rival from the true explanation."""
        return float(norm.cdf(self.beyond[true, rival]))

    @property
    def probability(self) -> float:
        """Probability that the true explanation alone is left, each as likely to be true."""
        least = [min(self.power(*key) for key in self.models if key[0] == true) for true, _ in self.models]
        return float(np.mean(least))


def information(contest: Contest, reference: np.ndarray) -> Information | None:
    """Expected information of a reference (frames, references) [SI]; None if a run does not reach its end."""
    likelihood = contest.view(contest.trial(0, reference))
    found = [differentiate(likelihood, e, e.x) for e in contest.explanations]
    rows, bare = np.array([e.residual for e in found]), likelihood.residual(contest.bare)
    columns, missed = [], []
    for e, spread in zip(found, contest.spreads, strict=True):
        jacobian = whole_jacobian(likelihood, e)
        columns.append(spread.T @ jacobian)
        missed.append(nonlinearity(likelihood, e, jacobian, spread))
    if not all(np.isfinite(part).all() for part in (rows, bare, *missed, *columns)):
        return None
    models = {}
    for i, j in permutations(range(len(rows)), 2):
        variance = likelihood.memory * (contest.chi2[i] + missed[i] + missed[j])
        models[i, j] = pair_model(rows[j] - rows[i], columns[j], 1.0 / variance)
    power = contest.own * np.sum((bare - rows) ** 2, axis=1) / (likelihood.memory * contest.chi2)
    return Information(models, contest.taken + power, contest)


def nonlinearity(likelihood: Likelihood, e: Explanation, jacobian: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Mean squares (samples,) of what drawn robots miss the linearisation by, over all columns and the time about."""
    draws = np.random.default_rng(0).standard_normal((DRAWS, spread.shape[1]))
    points = np.clip(e.x + draws @ spread.T, *e.bounds)
    drawn = np.array([one.residual for one in e.at_each(likelihood, [*points])])
    missed = np.mean((drawn - e.residual - (points - e.x) @ jacobian) ** 2, axis=0)
    width, frames = len(likelihood.views[0].problem.columns), max(round(likelihood.memory), 1)
    return np.repeat(uniform_filter1d(missed.reshape(-1, width).mean(axis=1), frames, mode="nearest"), width)


def refit(contest: Contest, reference: np.ndarray) -> Information | None:
    """Expected information of a reference (frames, references) [SI], rivals refitted to it and the present logs."""
    found = information(contest, reference)
    if found is None:
        return None
    present, ended = contest.likelihood.views[0], {}
    for true, rival in found.models:
        e, scale = contest.explanations[rival], float(np.sqrt(contest.likelihood.memory * contest.chi2[true]))
        both = contest.view(*present.problem.fit, contest.trial(true, reference), scale=scale)
        fit = minimise(both, differentiate(both, e, found.refit(true, rival)), STEPS)
        before = replace(contest.likelihood, views=(replace(present, scale=scale),))
        ended[true, rival] = max(2.0 * (fit.cost(both) - e.cost(before)), 0.0), fit.x
    return replace(found, ended=ended)
