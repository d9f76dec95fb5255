"""Closure: the gap on held-out logs with the nominal, the retuned and the improved robot, in closed loop.

    C = 1 - (MSE_after - noise variance) / (MSE_before - noise variance)     1: down to the noise, 0: nothing gained

The intervals come from one bootstrap over blocks of time. Held-out logs serve the closure alone.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from exodrake.core.confidence import CONFIDENCE
from exodrake.diagnosis.likelihood import stretch_length
from exodrake.diagnosis.noise import mismatch
from exodrake.diagnosis.parameter import apply
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import Closure, Interval, SignalGap
from exodrake.diagnosis.search import Fitted
from exodrake.model.robot import Robot

DRAWS = 400


def change_robot(problem: Problem, values: np.ndarray, found_in: str) -> Robot:
    """The nominal robot with what a fit changed, noise and resolutions as they were.

    values: (parameters,) flat vector of a noise-free fitted robot [SI]. found_in: name of the case.
    """
    nominal = problem.robot
    changed = values != replace(problem, detected=()).silent()
    source = f"fitted to {found_in} on {datetime.now(UTC):%Y-%m-%d}"
    sources = {e.name: source for e, c in zip(nominal.machine.parameters, changed, strict=True) if c}
    return replace(nominal, values=np.where(changed, values, nominal.values), sources={**nominal.sources, **sources})


def without_logs(fitted: Fitted, logs: Collection[int]) -> np.ndarray:
    """Flat vector (parameters,) [SI] of the robot that is fitted to all logs but some: a Gauss-Newton step off."""
    e, others = fitted.explanation, ~np.isin(fitted.model.log, list(logs))
    return apply(e.values, e.parameters, np.clip(e.x + fitted.model.posterior(others).step, *e.bounds))


def kinds_of_motion(problem: Problem) -> dict[str, str]:
    """Kind of motion of each log: its protocol without the number of a run, as `sweeps` of `sweeps_2`."""
    protocols = {item.file: item.protocol for item in problem.case.logs}
    names = [trial.name for trial in (*problem.fit, *problem.holdout)]
    return {n: re.sub(r"[-_ ]*\d+$", "", protocols.get(n, n)) or protocols.get(n, n) for n in names}


def group_by_motion(problem: Problem) -> dict[str, list[int]]:
    """Positions of the fitted logs of each kind of motion."""
    kinds, groups = kinds_of_motion(problem), defaultdict[str, list[int]](list)
    for k, trial in enumerate(problem.fit):
        groups[kinds[trial.name]].append(k)
    return groups


def predict_left_out(problem: Problem, fitted: Fitted) -> float:
    """RMS error [noise_std] on kinds of motion that are left out of the fit, one at a time; infinite of a single log.

    Logs where all are of one kind. Cross-validation by blocks that have something in common (Roberts et al. 2017).
    """
    groups, left = [*group_by_motion(problem).values()], list[np.ndarray]()
    groups = groups if len(groups) > 1 else [[k] for k in range(len(problem.fit))]
    for logs in groups if len(groups) > 1 else ():
        trials = tuple(problem.fit[k] for k in logs)
        left.append(problem.residual(without_logs(fitted, logs)[None], trials)[0])
    return float(np.sqrt(np.mean(np.concatenate(left) ** 2))) if left else np.inf


def measure_closure(problem: Problem, retuned: Fitted, best: Fitted, rows: np.ndarray) -> Closure:
    """Closure on the judged logs, and on each kind of fitted motion by the robot that is fitted to the other kinds.

    Without held-out logs, each fitted log is judged by robots fitted to the others.

    retuned, best: fits without an effect and with the effects. rows: (3, parameters) nominal, retuned and improved
    robot [SI].
    """

    def robots(logs: Collection[int]) -> np.ndarray:
        return np.array([rows[0], without_logs(retuned, logs), without_logs(best, logs)])

    alone = problem.holdout or len(problem.fit) == 1
    found = measure(problem, [rows if alone else robots([k]) for k in range(len(problem.judged))])
    kinds, groups, motions = kinds_of_motion(problem), group_by_motion(problem), dict[str, Interval]()
    for kind, logs in groups.items() if len(groups) > 1 and best.effects else ():
        part = replace(problem, holdout=(), fit=tuple(problem.fit[k] for k in logs))
        motions[kind] = measure(part, [robots(logs)] * len(logs)).overall
    measured_on = tuple(dict.fromkeys(kinds[trial.name] for trial in problem.judged))
    return replace(found, measured_on=measured_on, motions=motions)


def measure(problem: Problem, rows: Sequence[np.ndarray]) -> Closure:
    """Gap and closure, overall and per signal, in closed loop.

    rows: for each log of `Problem.judged` (3, parameters) flat parameter vectors [SI] of the nominal, the retuned and
    the improved robot.
    """
    machine, logs = problem.robot.machine, []  # of each log (3, n, columns) [noise_std]
    for trial, robots in zip(problem.judged, rows, strict=True):
        simulated = problem.predict(robots, trial)
        gaps = np.array([mismatch(trial.measured, one, problem.notched, machine.frame) for one in simulated])
        wild = problem.wild
        bounded = np.where(np.isnan(gaps), wild, gaps / problem.noise_std).clip(-wild, wild)
        logs.append(np.where(np.isfinite(trial.measured), bounded, np.nan))
    squares = np.concatenate(logs, axis=1) ** 2
    length = stretch_length(squares.shape[1], machine.frame)
    (nominal, samples), (retuned, _), (improved, _) = (blocks([log[k] for log in logs], length) for k in range(3))
    picks = np.random.default_rng(0).integers(0, len(samples), (DRAWS, len(samples)))
    signals = {}
    for column, kind, noise_std, own in zip(
        problem.columns, problem.kinds, problem.noise_std.tolist(), np.moveaxis(squares, -1, 0), strict=True
    ):
        known = [one[np.isfinite(one)] for one in own]
        unit = machine.signal[machine.column(kind).signal].unit
        before, retuned_rms, after = (noise_std * float(np.sqrt(one.mean())) for one in known)
        value = closure(known[0], known[-1])
        signals[column] = SignalGap(before, retuned_rms, after, noise_std, value, unit)
    return Closure(
        overall=bootstrap(nominal, improved, samples, picks),
        retune=bootstrap(nominal, retuned, samples, picks),
        effect=bootstrap(retuned, improved, samples, picks),
        signals=signals,
    )


def closure(before: np.ndarray, after: np.ndarray, samples: np.ndarray | None = None) -> float:
    """Closure from mean squares in noise variances (any shape), of so many samples each; NaN where there was no gap."""
    gap, left = (float(np.average(squares, weights=samples)) - 1.0 for squares in (before, after))
    return 1.0 - max(left, 0.0) / gap if gap > 0.0 else float("nan")


def bootstrap(before: np.ndarray, after: np.ndarray, samples: np.ndarray, picks: np.ndarray) -> Interval:
    """Closure from mean squares of so many samples (blocks,), with the interval of `picks` (draws, blocks)."""
    value = closure(before, after, samples)
    draws = np.array([closure(before[pick], after[pick], samples[pick]) for pick in picks])
    draws = draws[np.isfinite(draws)]
    if not np.isfinite(value) or not len(draws):
        return Interval(float("nan"), float("nan"), float("nan"))
    low, high = np.quantile(draws, [0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2])
    return Interval(value, float(min(low, value)), float(max(high, value)))


def blocks(residuals: list[np.ndarray], length: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean square of each block of time (blocks,) and its number of samples (blocks,), without missing ones.

    The last block of a log may be shorter.
    """
    parts = [r[i : i + length] for r in residuals for i in range(0, len(r), length)]
    parts = [part for part in parts if np.isfinite(part).any()]
    samples = np.array([np.isfinite(part).sum() for part in parts])
    return np.array([np.nanmean(part**2) for part in parts]), samples
