"""Noise standard deviation of each signal.

It comes from trials that repeat the same reference, else from two simulated runs of the nominal robot, whose loop
passes sensor noise on to every signal.

Rounding to a resolution q adds q^2/12 to the noise of a reading; two runs of one motion round alike, so repeats do not
show it.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.data.case import Case
from exodrake.diagnosis.filters import Bands, filled, without
from exodrake.simulation.references import reference_rows
from exodrake.simulation.simulate import log_of, run

ROBUST = 1.4826  # standard deviation of a normal law over its median absolute deviation
LIMIT = 3.0  # standard deviations at which deviations are clipped; efficiency of 0.99 for a normal law
WITHIN = 0.995  # variance of a normal law that is clipped so, over its variance
STEPS = 5  # of the iteration, which leave an error of 1e-5 where rounding is half of the noise
# independent samples in a sample, 1 / (1 + 2 sum rho_k^2): less than the 0.5 to 0.9 of most robots' repeats; assumed
INDEPENDENT = 0.37


def sensor_noise_std(robot: Robot) -> dict[str, float]:
    """Noise standard deviation per kind of signal by the robot's parameters [SI]; none where the machine has none."""
    return robot.machine.noise_std(robot.__getitem__) if robot.machine.noise_std else {}


def robust_std(values: np.ndarray) -> float:
    """Standard deviation of values (n,), robust to rare ones, which are clipped (proposal 2 of Huber 1964).

    Its iteration begins at the median absolute deviation, which itself is too coarse where values are rounded, and is 0
    where most are equal.
    """
    deviations = np.abs(values - np.median(values))
    std = ROBUST * float(np.median(deviations))
    for _ in range(STEPS):
        std = float(np.sqrt(np.mean(np.minimum(deviations, LIMIT * std) ** 2) / WITHIN))
    return std


def repeat_noise_std(case: Case, column: str, notched: Bands, period: float) -> float | None:
    """Standard deviation of one trial about its repeats, robust to rare events; None where nothing repeats."""
    spreads = []
    for group in case.repeat_groups:
        logs = [item.log for item in group if item.log.has(column)]
        for a, b in pairwise(logs):
            n = min(len(a), len(b))
            difference = filled(a[column][:n] - b[column][:n])
            difference = without(notched, difference[:, None], period)[:, 0]
            spreads.append(robust_std(difference) / np.sqrt(2.0))
    return float(np.median(spreads)) if spreads else None


def simulated_noise_std(case: Case, robot: Robot, columns: tuple[str, ...]) -> dict[str, float]:
    """Standard deviation of a run about its repeat [unit of the column], by simulating the first fitted reference."""
    reference = Reference(np.nan_to_num(reference_rows(robot.machine, case.fit_logs[0].log)), "noise")
    a, b = (log_of(run(robot, reference, seed=seed, quantisation=False)) for seed in (0, 1))
    return {c: float(np.std(a[c] - b[c]) / np.sqrt(2.0)) for c in columns}


def noise_std(case: Case, robot: Robot, columns: tuple[str, ...], notched: Bands = ()) -> np.ndarray:
    """Noise of each column [its unit]: the larger of what runs differ by and what the sensor's parameters say.

    notched: bands [Hz] that are left out.
    """
    parameters = sensor_noise_std(robot)
    expected = {} if case.repeat_groups else simulated_noise_std(case, robot, columns)
    found = []
    for column in columns:
        kind = column.rsplit("_", 1)[0]
        differ = repeat_noise_std(case, column, notched, robot.machine.frame)
        found.append(max(parameters.get(kind, 0.0), differ or expected.get(column, 0.0)))
        if found[-1] <= 0.0:
            raise InputError(f"{case.name}: noise of {column} unknown: nothing repeats and no sensor number says")
    return np.array(found)


def noise_uncertainty(case: Case) -> float:
    """Relative standard deviation of a noise standard deviation that is taken from so many samples (normal law)."""
    lengths = [len(item.log) for group in case.repeat_groups for item in group[1:]] or [len(case.fit_logs[0].log)]
    return float(1.0 / np.sqrt(2.0 * INDEPENDENT * sum(lengths)))
