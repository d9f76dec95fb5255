"""Suspicious noise: as large as the motion, above the sensor's, or far below it."""

from __future__ import annotations

import numpy as np

from exodrake.core.machine import Machine
from exodrake.diagnosis.checks.compare import Channel, Comparison, few, places, white_share
from exodrake.diagnosis.checks.scale import unit_factor
from exodrake.diagnosis.noise import robust_std

HALF = 0.5  # of the variance: more noise than motion, a signal-to-noise ratio of 1
CLEAR = 2.0  # ratio of standard deviations with p < 1e-3 from 25 independent samples on (F test); of shares: assumed
EXACT = 1e-9  # of a signal's range: smaller steps are rounding of the computer
ABOVE = 1.1  # of the nominal fast noise in every channel of a sensor; healthy robots and most faults stay below 1.04
ORDER = 4  # differences that leave noise of what moves slowly (assumed)
LEAST_MOTION = 5.0  # motion over noise below which a signal says little: assumed
GAIN = 70.0  # of differences of that order on white noise: the sum of squared binomial coefficients


def noise_as_large_as_motion(comparison: Comparison) -> list[str]:
    """More than half of a channel's variance is noise, by its whiteness or by its repeats, unlike the nominal robot."""
    found = [
        c for c in comparison.channels if white_share(c.measured) > max(HALF, CLEAR * white_share(c.nominal))
    ] + unrepeatable(comparison)
    if not found:
        return []
    return [f"noise is as large as the motion in {places(found)}: almost any cause would explain such a channel"]


def unrepeatable(comparison: Comparison) -> list[Channel]:
    """Channels whose repeats differ by more than half of their variance, unlike the nominal robot's."""
    found = []
    for column in comparison.columns:
        channels = comparison.of(column)
        variance, nominal_variance = (sum(np.var(getattr(c, x)) for c in channels) for x in ("measured", "nominal"))
        for group in comparison.case.repeat_groups:
            runs = [c for c in channels if c.file in [item.file for item in group]]
            noise, nominal = (repeat_variance([getattr(c, x) for c in runs]) for x in ("measured", "nominal"))
            share = len(channels) * noise / variance if variance > 0.0 else 0.0
            nominal_share = len(channels) * nominal / nominal_variance if nominal_variance > 0.0 else 0.0
            found += runs if share > max(HALF, CLEAR * nominal_share) else []
    return found


def repeat_variance(runs: list[np.ndarray]) -> float:
    """Variance of the noise by which the first and the last of some runs (n,) differ, robust to rare events."""
    if len(runs) < 2:
        return 0.0
    rows = min(map(len, runs))
    return robust_std(runs[0][:rows] - runs[-1][:rows]) ** 2 / 2.0


def noise_far_below_sensor(comparison: Comparison) -> list[str]:
    """The fast noise of a channel is less than half of the nominal robot's, as in logs that were smoothed."""
    found = []
    for column in comparison.columns:
        channels = [c for c in comparison.of(column) if carries_noise(c)]
        if channels and np.median([louder(c) for c in channels]) < 1.0 / CLEAR:
            found.append(column)
    if not found:
        return []
    return [
        f"fast noise of {few(found)} is less than half of what the robot file says: were the logs smoothed? A fit may "
        "look too good"
    ]


def noise_above_sensor(comparison: Comparison) -> list[str]:
    """The fast noise of all channels that a sensor's noise reaches is larger than the nominal robot's.

    A diagnosis takes the noise of a sensor from the robot file, since what makes a loop hunt is a cause and no noise.
    With a noisier sensor no explanation leaves as little as it should.
    """
    if noise_as_large_as_motion(comparison):
        return []
    found = []
    for parameter, reached in noise_parameters(comparison.machine).items():
        kinds = [kind for kind in comparison.kinds if kind in reached]
        columns = [comparison.columns[i] for kind in kinds for i in comparison.kinds[kind]]
        logs = [[louder(c) for c in comparison.of(column) if carries_noise(c)] for column in columns]
        least = min((float(np.median(ratios)) if ratios else 0.0 for ratios in logs), default=0.0)
        if least > ABOVE:
            found.append(
                f"fast noise of {few(kinds)} is {least:.2g} times what the robot file says: a vibration, or noisier "
                f"sensors, whose {parameter} then belongs under `robot:` in case.yaml"
            )
    return found


def noise_parameters(machine: Machine) -> dict[str, list[str]]:
    """Noise parameters of sensors -> the kinds of signal whose noise depends on them; none where none is stated."""
    if machine.noise_std is None:
        return {}
    plain = machine.noise_std(lambda name: 1.0)
    doubled = {p: machine.noise_std(lambda name, p=p: 2.0 if name == p else 1.0) for p in machine.noise}
    return {p: [kind for kind, std in stds.items() if std > plain[kind]] for p, stds in doubled.items()}


def louder(channel: Channel) -> float:
    """Ratio of the fast noise of a channel, in the unit that it seems to have, to the nominal robot's."""
    return fast_noise(channel.measured / unit_factor(channel)) / fast_noise(channel.nominal)


def carries_noise(channel: Channel) -> bool:
    """Whether rounding leaves the noise: more than a step in the nominal log, and most measured samples change."""
    steps = np.abs(np.diff(channel.nominal))
    smallest = steps[steps > EXACT * np.ptp(channel.nominal)].min(initial=np.inf)
    return bool(fast_noise(channel.nominal) > smallest and np.median(np.abs(np.diff(channel.measured))) > 0.0)


def fast_noise(values: np.ndarray) -> float:
    """Standard deviation of white noise in a signal (n,) that moves slowly, by fourth differences; 0 if rounding."""
    found = robust_std(np.diff(values, ORDER)) / np.sqrt(GAIN)
    return 0.0 if found <= np.finfo(float).eps * np.nanmax(np.abs(values), initial=0.0) else found


def moves(values: np.ndarray, rounding: float = 0.0) -> bool:
    """Whether a signal (n,) varies by more than its fast noise and a rounding step [unit of the signal]."""
    return bool(np.ptp(values) > 0.0 and np.std(values) > LEAST_MOTION * max(fast_noise(values), rounding))


def rounding_step(values: np.ndarray) -> float:
    """Smallest change of a rounded signal (n,), whose samples mostly repeat; 0 for another one and for a constant."""
    steps = np.abs(np.diff(values))
    return float(np.min(steps, initial=np.inf, where=steps > 0.0)) if steps.any() and np.median(steps) == 0.0 else 0.0
