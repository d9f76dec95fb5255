"""Noise standard deviation of each signal: from trials that repeat a reference, else from runs of the nominal robot.

Rounding to a resolution q adds q^2/12 to the noise of a reading; two runs of one motion round alike, so repeats do not
show it.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.case import Case
from exodrake.data.log import fill_gaps
from exodrake.diagnosis.filters import Bands, without
from exodrake.engine.inputs import Reference
from exodrake.model.robot import Robot
from exodrake.simulation.references import reference_rows
from exodrake.simulation.simulate import run, write_log

ROBUST = 1.4826  # standard deviation of a normal law over its median absolute deviation
LIMIT = 3.0  # standard deviations at which deviations are clipped; efficiency of 0.99 for a normal law
WITHIN = 0.995  # variance of a normal law that is clipped so, over its variance
STEPS = 5  # of the iteration, which leave an error of 1e-5 where rounding is half of the noise


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


def noise_std(case: Case, robot: Robot, columns: tuple[str, ...], notched: Bands = ()) -> np.ndarray:
    """Noise of each column [its unit]: the larger of what runs differ by and what the sensor's parameters say.

    Runs are a trial and its repeats, where rare events count little, else two simulations of the first fitted
    reference. notched: bands [Hz] that are left out.
    """
    parameters, simulated, found = sensor_noise_std(robot), {}, []
    if not case.repeat_groups:
        reference = Reference(np.nan_to_num(reference_rows(robot.machine, case.fit_logs[0].log)), "noise")
        a, b = (write_log(run(robot, reference, seed=seed, quantisation=False)) for seed in (0, 1))
        simulated = {c: float(np.std(a[c] - b[c]) / np.sqrt(2.0)) for c in columns}
    for column in columns:
        logs = [[item.log[column] for item in group if item.log.has(column)] for group in case.repeat_groups]
        spreads = []
        for a, b in (pair for group in logs for pair in pairwise(group)):
            n = min(len(a), len(b))
            difference = without(notched, fill_gaps(a[:n] - b[:n])[:, None], robot.machine.frame)[:, 0]
            spreads.append(robust_std(difference) / np.sqrt(2.0))
        differ = float(np.median(spreads)) if spreads else 0.0
        found.append(max(parameters.get(column.rsplit("_", 1)[0], 0.0), differ or simulated.get(column, 0.0)))
        if found[-1] <= 0.0:
            raise InputError(f"{case.name}: noise of {column} unknown: nothing repeats and no sensor number says")
    return np.array(found)
