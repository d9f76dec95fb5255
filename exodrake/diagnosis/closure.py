"""Closure: the gap on held-out logs with the nominal, the retuned and the improved robot, in closed loop.

    C = 1 - (MSE_after - noise variance) / (MSE_before - noise variance)     1: down to the noise, 0: nothing gained

It is measured in two steps, nominal to retuned and retuned to improved. The intervals come from one bootstrap over
blocks of time. Held-out logs serve the closure alone. Without any, each fitted log is judged by robots fitted to the
others (`left_out`). In the band of a tremor its strength counts, not its phase (`filters.mismatch`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from exodrake.core.confidence import CONFIDENCE
from exodrake.diagnosis.filters import mismatch
from exodrake.diagnosis.gap import Closure, Interval, SignalGap
from exodrake.diagnosis.problem import WILD, Problem

PART, LEAST = 2.0, 8  # block [s], longer than the loop's memory; blocks at least, shorter ones of short logs: assumed
DRAWS = 400


def residuals(problem: Problem, rows: Sequence[np.ndarray]) -> list[list[np.ndarray]]:
    """Residuals of robots on the logs that they are judged by, in closed loop.

    Args:
        problem: the case.
        rows: for each of these logs (robots, parameters) flat parameter vectors [SI].

    Returns:
        For each robot the (n, columns) residuals of the logs [noise_std], NaN where nothing was measured.
    """
    period, found = problem.robot.machine.frame, []
    for trial, robots in zip(problem.judged, rows, strict=True):
        simulated = problem.predict(robots, trial)
        gaps = [mismatch(trial.measured, one, problem.notched, period) / problem.noise_std for one in simulated]
        bounded = [np.nan_to_num(gap, nan=WILD, posinf=WILD, neginf=-WILD).clip(-WILD, WILD) for gap in gaps]
        found.append([np.where(np.isfinite(trial.measured), gap, np.nan) for gap in bounded])
    return [list(logs) for logs in zip(*found, strict=True)]


def closure(before: np.ndarray, after: np.ndarray, samples: np.ndarray | None = None) -> float:
    """Closure from mean squares in noise variances (any shape), of so many samples each; NaN where there was no gap."""
    gap = float(np.average(before, weights=samples)) - 1.0
    left = float(np.average(after, weights=samples)) - 1.0
    return 1.0 - max(left, 0.0) / gap if gap > 0.0 else float("nan")


def measure(problem: Problem, rows: Sequence[np.ndarray], seed: int = 0) -> Closure:
    """Gap and closure, overall and per signal.

    Args:
        problem: the case.
        rows: for each log of `Problem.judged` (3, parameters) flat parameter vectors [SI] of the nominal, the retuned
            and the improved robot.
        seed: of the bootstrap.
    """
    logs = residuals(problem, rows)
    (nominal, retuned, improved), samples, picks = resampled(problem, logs, seed)
    signals = {c: signal(problem, i, *logs) for i, c in enumerate(problem.columns)}
    return Closure(
        overall=bootstrapped(nominal, improved, samples, picks),
        retune=bootstrapped(nominal, retuned, samples, picks),
        effect=bootstrapped(retuned, improved, samples, picks),
        signals=signals,
    )


def overall(problem: Problem, rows: Sequence[np.ndarray], seed: int = 0) -> Interval:
    """Closure from one robot to another; rows: for each log of `Problem.judged` (2, parameters) flat vectors [SI]."""
    (before, after), samples, picks = resampled(problem, residuals(problem, rows), seed)
    return bootstrapped(before, after, samples, picks)


def resampled(
    problem: Problem, logs: list[list[np.ndarray]], seed: int
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Blocks for a bootstrap.

    Returns:
        Mean squares (blocks,) of each robot's residuals, samples (blocks,) in each, and picks (draws, blocks) of them.
    """
    frames = sum(len(log) for log in logs[0])
    length = max(1, min(round(PART / problem.robot.machine.frame), frames // LEAST))
    found = [blocks(one, length) for one in logs]
    means, samples = [mean for mean, _ in found], found[0][1]
    return means, samples, np.random.default_rng(seed).integers(0, len(samples), (DRAWS, len(samples)))


def bootstrapped(before: np.ndarray, after: np.ndarray, samples: np.ndarray, picks: np.ndarray) -> Interval:
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


def signal(
    problem: Problem, i: int, before: list[np.ndarray], tuned: list[np.ndarray], after: list[np.ndarray]
) -> SignalGap:
    """Gap of one signal in its unit."""
    noise_std = float(problem.noise_std[i])
    b, t, a = (np.concatenate([r[:, i] for r in residuals]) ** 2 for residuals in (before, tuned, after))
    b, t, a = (x[np.isfinite(b)] for x in (b, t, a))
    rms = [noise_std * float(np.sqrt(x.mean())) for x in (b, t, a)]
    kind = problem.kinds[i]
    unit = next(problem.robot.machine.signal[c.signal].unit for c in problem.robot.machine.columns if c.kind == kind)
    return SignalGap(rms[0], rms[1], rms[2], noise_std, closure(b, a), unit)
