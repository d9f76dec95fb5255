"""Noise floor of each signal: from trials that repeat the same reference, else from two simulated runs of the nominal robot, whose loop
passes sensor noise on to every signal.

Rounding to a resolution q adds q^2/12 to the noise of a reading; two runs of one motion round alike, so repeats do not show it.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from exodrake.case import Case
from exodrake.diagrams.robot import Robot
from exodrake.diagrams.simulate import Reference, simulate

KINDS = ("tension", "stroke", "speed_cmd", "angle")
TWELFTH = 1.0 / 12.0  # variance of a rounding error in units of its step squared
ROBUST = 1.4826  # standard deviation of a normal law over its median absolute deviation


def sensor_floor(robot: Robot) -> dict[str, float]:
    """Floor per kind of signal from the robot's numbers: N, m, m/s, rad."""
    tension = np.sqrt(robot["sensor.sigma_F"] ** 2 + TWELFTH * robot["sensor.q_F"] ** 2)
    damped = np.hypot(
        robot["controller.kp"] + robot["controller.kd"] / robot["controller.period"],
        robot["controller.kd"] / robot["controller.period"],
    )
    step = robot["encoder.q_theta"] * robot["encoder.radius"]
    return {
        "tension": float(tension),
        "stroke": float(np.sqrt(TWELFTH) * step),
        "speed_cmd": float(tension * damped),
        "angle": robot["mocap.sigma_q"],
    }


def repeat_floor(case: Case, column: str) -> float | None:
    """Standard deviation of one trial about its repeats, robust to rare events; None where nothing repeats."""
    spreads = []
    for group in case.repeat_groups:
        logs = [item.log for item in group if item.log.has(column)]
        for a, b in pairwise(logs):
            n = min(len(a), len(b))
            difference = a[column][:n] - b[column][:n]
            spreads.append(ROBUST * np.nanmedian(np.abs(difference - np.nanmedian(difference))) / np.sqrt(2.0))
    return float(np.median(spreads)) if spreads else None


def simulated_floor(case: Case, robot: Robot, columns: tuple[str, ...]) -> dict[str, float]:
    """Standard deviation of a run about its repeat [unit of the column], by simulation of the first fitted reference."""
    reference = Reference(np.nan_to_num(case.fit_logs[0].log.array("tension_ref")), "floor")
    a, b = (simulate(robot, reference, seed=seed, quantisation=False) for seed in (0, 1))
    return {c: float(np.std(a[c] - b[c]) / np.sqrt(2.0)) for c in columns}


def noise_floor(case: Case, robot: Robot, columns: tuple[str, ...]) -> np.ndarray:
    """Floor of each column [its unit]: the larger of what runs differ by and what the sensor's numbers say."""
    numbers = sensor_floor(robot)
    expected = {} if case.repeat_groups else simulated_floor(case, robot, columns)
    found = []
    for column in columns:
        kind = next(k for k in KINDS if column.startswith(k))
        found.append(max(numbers[kind], repeat_floor(case, column) or expected.get(column, 0.0)))
    return np.array(found)
