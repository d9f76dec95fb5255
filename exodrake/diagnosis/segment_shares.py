"""Localisation by replay: Shapley shares of the segments between measured signals in the gap.

Each segment is fed with measured inputs (`compiled.run`), so that it does not inherit an error from upstream. Parts
between two measured signals form one segment. A segment is *fixed* by putting its measured output in place of the
simulated one. Its Shapley share is its mean part in the fall of the gap over all orders of fixing, exact over all
subsets.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations
from math import factorial

import numpy as np

from exodrake.compiled.inputs import NoiseInputs, Reference, input_rows
from exodrake.compiled.run import Replay
from exodrake.core.machine import Machine
from exodrake.core.segment import Segment
from exodrake.diagnosis.filters import filled_columns
from exodrake.diagnosis.problem import Problem, Trial
from exodrake.simulation.simulate import run

WINDOW, ORDER = 7, 2  # frames and order of the Savitzky-Golay filter that smooths what is fed in
# a segment that makes the error this many times larger when fed with measurements integrates them, as a free mass does
RUNAWAY = 10.0


def suspects(machine: Machine) -> tuple[Segment, ...]:
    """Segments that may cause a gap: all but software of known law."""
    return tuple(segment for segment in machine.segments if not segment.exact)


def smoothed(rows: np.ndarray) -> np.ndarray:
    """Measured columns (n, channels) [SI] without gaps, noise and encoder steps smoothed."""
    from scipy.signal import savgol_filter

    whole = filled_columns(rows)
    return np.asarray(savgol_filter(whole, WINDOW, ORDER, axis=0)) if len(whole) > WINDOW else whole


def fed(problem: Problem, trial: Trial) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed outputs of all segments (n, feeds) [SI] and their rates [SI/s]; zeros where one was not measured."""
    machine, found = problem.robot.machine, []
    for segment in machine.segments:
        columns = [k == segment.output for k in problem.kinds]
        shape = len(trial.measured), machine.column_width(segment.output)
        found.append(smoothed(trial.measured[:, columns]) if sum(columns) == shape[1] else np.zeros(shape))
    feed = np.concatenate(found, axis=1)
    return feed, np.gradient(feed, machine.frame, axis=0)


def replayed(problem: Problem, values: np.ndarray, trial: Trial, fixed: Iterable[str]) -> np.ndarray:
    """Log with some segments fixed to what was measured.

    Args:
        problem: columns and machine.
        values: (parameters,) flat parameters [SI].
        trial: measured log.
        fixed: names of the fixed segments.

    Returns:
        (n, columns) simulated log [SI].
    """
    machine = problem.robot.machine
    inputs = input_rows(machine, trial.reference, NoiseInputs.draw(len(trial.reference), None, machine))
    return Replay(machine, values, fixed).step(inputs.values(), *fed(problem, trial))[:, problem.signal_indices]


def subsets(names: Iterable[str]) -> list[frozenset[str]]:
    """All sets of segments."""
    whole = tuple(names)
    return [frozenset(s) for size in range(len(whole) + 1) for s in combinations(whole, size)]


def segment_gaps(problem: Problem, values: np.ndarray, trial: Trial) -> tuple[dict[str, float], dict[str, float]]:
    """Shapley share of each segment in the closed-loop gap, and its replay gap [noise standard deviations].

    What is fed in is noisy, and a stiff segment amplifies it. So the same replay of a log that the robot itself would
    have written, noise and rounding included, is subtracted. There are no shares where nothing is left, nor where a
    segment runs away with what it is fed.
    """
    power, gap_of = powers(problem, values, trial)
    noise_power, noise_gap = powers(problem, values, own_trial(problem, values, trial))
    net = {s: max(power[s] - noise_power[s], 0.0) for s in power}
    gaps = {s: float(np.sqrt(max(gap_of[s] ** 2 - noise_gap[s] ** 2, 0.0))) for s in gap_of}
    shares = shapley(net)
    if max(net.values()) > RUNAWAY * net[frozenset()]:
        return {}, {s: g for s, g in gaps.items() if g**2 * trial.measured.size < RUNAWAY * power[frozenset()]}
    return {s.name: shares[s.name] for s in suspects(problem.robot.machine)}, gaps


def own_trial(problem: Problem, values: np.ndarray, trial: Trial) -> Trial:
    """The trial as the robot itself would have logged it, with noise and rounding, the same samples missing."""
    machine, whole = problem.robot.machine, values.copy()
    silenced = [machine.index[name] for name in (*machine.noise, *machine.resolution)]
    whole[silenced] = problem.robot.values[silenced]
    recording = run(replace(problem.robot, values=whole), Reference(trial.reference, trial.name), seed=0)
    flat = np.concatenate([recording.signals[s.name] for s in machine.signals], axis=1)
    return replace(trial, measured=np.where(np.isfinite(trial.measured), flat[:, problem.signal_indices], np.nan))


def powers(problem: Problem, values: np.ndarray, trial: Trial) -> tuple[dict[frozenset[str], float], dict[str, float]]:
    """Power of the normalised residual for each set of fixed segments, and each segment's replay gap.

    The power sums over the columns that no fixed segment puts in place; the gap is the root mean square of a segment's
    own columns while all the others are fixed [noise standard deviations]. Missing samples count in neither.
    """
    output = {s.name: s.output for s in suspects(problem.robot.machine)}
    power, gap_of = {}, {}
    for fixed in subsets(output):
        difference = np.nan_to_num((trial.measured - replayed(problem, values, trial, fixed)) / problem.noise_std)
        free = [k not in {output[s] for s in fixed} for k in problem.kinds]
        power[fixed] = float(np.sum(difference[:, free] ** 2))
        if len(fixed) == len(output) - 1:
            (segment,) = set(output) - fixed
            own = [k == output[segment] for k in problem.kinds]
            known = np.isfinite(trial.measured[:, own])
            gap_of[segment] = float(np.sqrt(np.mean(difference[:, own] ** 2, where=known))) if known.any() else 0.0
    return power, gap_of


def shapley(power: dict[frozenset[str], float]) -> dict[str, float]:
    """Shares, summing to 1, of the fall of `power` (set of fixed segments -> value) from none to all fixed."""
    everything = max(power, key=len)
    n, shares = len(everything), {}
    for segment in sorted(everything):
        shares[segment] = sum(
            factorial(len(s)) * factorial(n - len(s) - 1) / factorial(n) * (value - power[s | {segment}])
            for s, value in power.items()
            if segment not in s
        )
    total = sum(shares.values())
    return {name: value / total if total else 0.0 for name, value in shares.items()}
