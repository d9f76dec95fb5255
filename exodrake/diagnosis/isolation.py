"""Isolation: from a case to the set of effects that explains it best, and the sets beside it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.diagnosis.detect import detect
from exodrake.diagnosis.fit import HALF, Explanation, minimise, settle
from exodrake.diagnosis.intervals import find_traces, fitted_effects
from exodrake.diagnosis.likelihood import Likelihood, make_likelihood, output_error, with_prediction
from exodrake.diagnosis.linearise import nominal_jacobian
from exodrake.diagnosis.noise import sensor_noise_std
from exodrake.diagnosis.parameter import nominal_parameters
from exodrake.diagnosis.problem import Problem, by_trial
from exodrake.diagnosis.search import FAR, Excess, Fitted, Search

USED, MOST = 15_000, 135_000  # samples that are fitted, and at most where the rest shows a gap that this part does not
SCREENED, LEAST_SCREENED = 0.75, 15_000  # part of them on which all effects are tried, and samples of it at least
PRECISE = 30_000  # samples to which the answer is fitted on: four times as many halve an interval
# Where the fitted part shows less than HIDDEN of the largest gap over a first part of the logs, or half (RMS) of what a
# set leaves, the shortest of so many PARTS is fitted that shows at least HALF of that. Assumed
PARTS, HIDDEN = 20, 0.02
SAMPLING = 3.0  # standard deviations of a mean square over runs with noise that a gap must exceed, too
ROUNDS, LEAST_GAIN = 3, 0.1  # nominal Jacobians of a fit; mean log chi-square that one gains for a next one


@dataclass(frozen=True, eq=False)
class Isolation:
    """What was tried on a case."""

    problem: Problem  # the part of the case that was fitted, with what detectors found
    whole: Problem  # the same with whole logs
    likelihood: Likelihood  # views of the part
    nominal: Explanation  # the nominal robot
    search: Search  # all fitted sets
    best: Fitted  # the best of them

    @property
    def retuned(self) -> Fitted:
        """The retuned robot without an effect."""
        return self.search.none

    @cached_property
    def beside_detections(self) -> float:
        """Share of the gap that certain detections leave to other effects; 1 without such."""
        whole, machine, robot = self.whole, self.whole.robot.machine, self.retuned.explanation.robot
        without = robot.copy()
        for name in (name for d in whole.detected for name in d.values):
            without[machine.index[name]] = whole.robot[name]
        if (without == robot).all():
            return 1.0
        rows = (replace(whole, notched=()).residual(without[None], whole.fit), whole.residual(robot[None], whole.fit))
        before, after = (max(float(np.mean(row**2)) - 1.0, 0.0) for row in rows)
        return float(np.clip(after / max(before, 1e-12), 1e-6, 1.0))

    @property
    def differs_between_runs(self) -> bool:
        """Whether most of the gap differs from run to run, so that retuning seems to leave nothing.

        What repeats of a motion differ by counts as noise. Beyond the sensors' own noise retuning then leaves more than
        that noise, and half of what the nominal robot leaves, in the worst column.
        """
        sensors, problem = sensor_noise_std(self.whole.robot), self.whole
        if not problem.case.repeat_groups:
            return False
        own = np.array([sensors.get(kind, noise) for kind, noise in zip(problem.kinds, problem.noise_std)])
        alone = replace(problem, noise_std=np.minimum(own, problem.noise_std))
        robots = self.nominal.robot, self.retuned.explanation.robot
        before, left = (excess_by_column(alone, robot, self.likelihood).max() for robot in robots)
        return bool(left > max(1.0, HALF * before))

    def excess(self, robot: np.ndarray) -> float:
        """What a robot leaves over the whole logs, as `Excess` has it."""
        return self.search.excess(robot).whole


def excess_by_column(
    problem: Problem, robot: np.ndarray, likelihood: Likelihood, shares: Sequence[float] | np.ndarray = (1.0,)
) -> np.ndarray:
    """What a robot leaves beyond noise and what is negligible (n, columns) [noise variances], over parts of the logs.

    Noise is what simulated runs with noise show (`View.squares`), with their scatter; what the sensors state at least.

    robot: (parameters,) flat vector. shares: (n,) the parts, each from the beginning of every log.
    """
    logs = [log**2 for log in by_trial(problem.residual(robot[None], problem.fit)[0], problem.fit)]
    counts = [[trial.count_frames(share) for trial in problem.fit] for share in shares]
    means = [np.concatenate([log[:n] for log, n in zip(logs, each)]).mean(axis=0) for each in counts]
    return np.array(means) - noise_by_column(likelihood) - problem.negligible**2


def noise_by_column(likelihood: Likelihood) -> np.ndarray:
    """Mean squares in closed loop (columns,) of simulated runs with noise, with their scatter [noise variances]."""
    runs = likelihood.views[0].squares
    assert runs is not None, "a likelihood of noise"
    return np.maximum(runs.mean(axis=0), 1.0) + SAMPLING * runs.std(axis=0, ddof=1)


def retune(problem: Problem, x: np.ndarray | None = None) -> tuple[Explanation, defaultdict[str, float]]:
    """The nominal parameters fitted to the prediction errors in units of the sensors' noise, and the simulated time.

    A loop that hunts or a finger that snaps over gives the closed-loop cost many minima; feedback of the measured
    outputs leaves few (Ljung 1999; multiple shooting, Bock 1983). x: where the fit begins.
    """
    nominal, values = nominal_parameters(problem.robot), problem.silent()
    likelihood = output_error(with_prediction(problem)[-1], "retune")
    x = np.zeros(len(nominal)) if x is None else x
    start = Explanation((), nominal, x, values, np.zeros(0), np.zeros((len(nominal), 0)))
    return fit_nominal(likelihood, start.at(likelihood, x)), likelihood.simulated


def isolate(
    problem: Problem, progress: StageProgress = no_progress, most: float = USED, before: Search | None = None
) -> Isolation:
    """The isolation of a case.

    most: samples that are fitted. before: sets that were fitted on fewer, where this search begins.
    """
    progress(Stage.RETUNE, "")
    part = affordable(problem, most)
    start, simulated = retune(problem.shorten(part))
    whole = detect(problem, start.robot)
    short = whole.shorten(part)
    certain = sum(d.certain for d in whole.detected)
    if certain:
        start, again = retune(short, start.x)
        simulated["retune"] += again["retune"]
    likelihood = make_likelihood(short, start.robot, simulated).for_stage("linearise")
    machine = problem.robot.machine
    (residual,) = likelihood.residual(start.robot[None])
    likelihood = likelihood.with_memory(residual)
    effects = tuple(e for e in machine.effects if e.id in short.tried)
    shares, measured = np.linspace(part, affordable(problem), PARTS), dict[bytes, Excess]()

    def excess(robot: np.ndarray) -> Excess:
        if (key := robot.tobytes()) not in measured:
            *gaps, left = excess_by_column(whole, robot, likelihood, (*shares, 1.0)).max(axis=1).tolist()
            enough = next((float(s) for s, gap in zip(shares, gaps) if gap >= HALF * max(gaps)), 1.0)
            shown = gaps[0] / max(gaps) if gaps[-1] > 0.0 else 1.0
            measured[key] = Excess(gaps[0], left, shown, enough * count_samples(problem))
        return measured[key]

    zero = replace(start, x=np.zeros(len(start.x)))
    if excess(zero.robot).whole < 0.0:
        none = np.zeros((len(start.x), likelihood.samples), dtype=np.float32)
        (retuned,) = replace(zero, jacobian=none).at_each(likelihood, [zero.x])
        effects = ()
    else:
        retuned = fit_nominal(likelihood, start.at_each(likelihood, [start.x])[0])
        if (hidden := excess(retuned.robot)).shown < HIDDEN:
            wide = make_likelihood(whole.shorten(affordable(problem, hidden.needed)), retuned.robot, simulated)
            by_more = fit_nominal(wide, retuned.at_each(wide, [retuned.x])[0])
            if excess(by_more.robot).whole >= 0.0:
                return isolate(problem, progress, hidden.needed)
            (retuned,) = retuned.at_each(likelihood, [by_more.x])
    (nominal,) = retuned.at_each(likelihood, [zero.x])
    share = max(SCREENED, affordable(short, LEAST_SCREENED))
    fine, logs = (likelihood.on(whole.shorten(affordable(whole, most))) for most in (PRECISE, MOST))
    gap = excess(retuned.robot).whole
    residual = (nominal if gap < 0.0 else retuned).residual
    search = Search(likelihood, effects, residual, share, fine, logs.for_stage("measure"), excess, progress=progress)
    search.add([retuned])
    if before is not None:
        search.take_over(before)
    best = search.none
    if effects and gap < 0.0:
        search.expand_nominal(nominal)
    elif effects:
        best = search.run(max(machine.max_effects - certain, 0))
        if best.effects and search.is_negligible(best):
            sparing = sorted(search.list_sparing(best, len(best.effects)), key=lambda f: f.tolerance_cost)
            best = next((f for f in sparing if search.is_negligible(f)), best)
            search.reduce(best.effects)
        elif best.effects and (left := excess(best.explanation.robot)).whole > FAR and left.shown < HALF**2:
            return isolate(problem, progress, left.needed, search)
    return Isolation(short, whole, likelihood, nominal, search, best)


def fit_on(found: Isolation, best: Fitted) -> tuple[Fitted, Fitted]:
    """The retuned robot and a set of effects, fitted on to more of the logs (`PRECISE` samples), without its traces."""
    search = found.search
    precise = search.fit_on(best)
    if gone := find_traces(fitted_effects(precise), found.whole.robot.machine):
        precise = max(search.fit_without(precise, gone), precise, key=search.evidence)
    return search.fit_on(found.retuned, precise.explanation.jacobian), precise


def fit_nominal(likelihood: Likelihood, e: Explanation) -> Explanation:
    """The nominal parameters of an explanation fitted in all views, with new derivatives as long as that gains.

    By all of them twice, then by those that show.
    """
    likelihood = likelihood.for_stage("retune")
    e = replace(e, jacobian=nominal_jacobian(likelihood, e))
    for k in range(ROUNDS):
        before = likelihood.mean_log(e.residual)
        seen = np.full(e.nominal, True) if k == 1 else None
        e = settle(likelihood, e, seen) if k else minimise(likelihood.scaled_to(e.residual), e)
        if before - likelihood.mean_log(e.residual) < LEAST_GAIN:
            break
    return e


def affordable(problem: Problem, most: float = MOST) -> float:
    """Part of the fitted logs that can be used in reasonable time and memory; most: samples that count."""
    return min(1.0, (most + len(problem.columns) * problem.settling) / count_samples(problem))


def count_samples(problem: Problem) -> int:
    """Number of samples of the fitted logs."""
    return sum(trial.measured.size for trial in problem.fit)
