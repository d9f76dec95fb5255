"""How far: the gap on held-out logs with the nominal, the retuned and the improved robot, in closed loop.

    C = 1 - (MSE_after - noise variance) / (MSE_before - noise variance)     1: down to the noise, 0: nothing gained

with an interval from a bootstrap over blocks of time. In the band of a tremor its strength counts, not its phase
(`signals.mismatch`).
"""

from __future__ import annotations

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.robot import Robot
from exodrake.diagnosis.filters import mismatch
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import Closure, Interval, SignalGap
from exodrake.simulation.simulate import Recording, record

PART = 2.0  # s, longer than the loop's memory
DRAWS = 400
CONFIDENCE = 0.90


def held_out(problem: Problem, robot: Robot, engine: str = "drake") -> list[np.ndarray]:
    """Residuals (n, columns) [noise_std] of a robot on the held-out logs, in closed loop in the Drake Diagram."""
    found = []
    for trial in problem.holdout:
        run = record(robot, Reference(trial.reference, trial.name), seed=None, quantisation=False, engine=engine)
        gap = mismatch(trial.measured, shown(problem, run), problem.notched, problem.robot.machine.frame)
        found.append(np.nan_to_num(gap / problem.noise_std))
    return found


def shown(problem: Problem, run: Recording) -> np.ndarray:
    """The problem's columns of a noise-free recording (n, columns) [SI]."""
    return np.concatenate([run.signals[w.name] for w in problem.robot.machine.signals], axis=1)[
        :, problem.signal_indices
    ]


def closure(before: np.ndarray, after: np.ndarray) -> float:
    """Closure from mean squares in noise standard deviations (any shape)."""
    gap = float(np.mean(before)) - 1.0
    return 1.0 - max(float(np.mean(after)) - 1.0, 0.0) / gap if gap > 0.0 else 0.0


def measure(problem: Problem, nominal: Robot, retuned: Robot, improved: Robot, seed: int = 0) -> Closure:
    """Gap and closure on the held-out logs, overall and per signal."""
    before, tuned, after = (held_out(problem, robot) for robot in (nominal, retuned, improved))
    length = max(1, round(PART / problem.robot.machine.frame))
    b, a = blocks(before, length), blocks(after, length)
    value = closure(b, a)
    rng = np.random.default_rng(seed)
    draws = [closure(b[pick], a[pick]) for pick in rng.integers(0, len(b), (DRAWS, len(b)))]
    low, high = np.quantile(draws, [0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2])
    signals = {c: signal(problem, i, before, tuned, after) for i, c in enumerate(problem.columns)}
    return Closure(Interval(value, float(min(low, value)), float(max(high, value))), signals)


def blocks(residuals: list[np.ndarray], length: int) -> np.ndarray:
    """Mean square of each block of time (blocks,)."""
    found = [np.mean(r[i : i + length] ** 2) for r in residuals for i in range(0, len(r) - length + 1, length)]
    return np.array(found or [np.mean(r**2) for r in residuals])


def signal(
    problem: Problem, i: int, before: list[np.ndarray], tuned: list[np.ndarray], after: list[np.ndarray]
) -> SignalGap:
    """Gap of one signal in its unit."""
    floor = float(problem.noise_std[i])
    b, t, a = (np.concatenate([r[:, i] for r in residuals]) ** 2 for residuals in (before, tuned, after))
    rms = [floor * float(np.sqrt(x.mean())) for x in (b, t, a)]
    kind = problem.kinds[i]
    unit = next(problem.robot.machine.signal[c.signal].unit for c in problem.robot.machine.columns if c.kind == kind)
    return SignalGap(rms[0], rms[1], rms[2], floor, closure(b, a), unit)
