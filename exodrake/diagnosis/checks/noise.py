"""Suspicious noise: as large as the motion, or far below the sensor's."""

from __future__ import annotations

import numpy as np

from exodrake.diagnosis.checks.compare import Channel, Comparison, few, places, white_share
from exodrake.diagnosis.checks.scale import unit_factor
from exodrake.diagnosis.noise import ROBUST

HALF = 0.5  # of the variance: more noise than motion, a signal-to-noise ratio of 1
CLEAR = 2.0  # ratio of standard deviations with p < 1e-3 from 25 independent samples on (F test); of shares: assumed
EXACT = 1e-9  # of a signal's range: smaller steps are rounding of the computer
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
    return mad_std(runs[0][:rows] - runs[-1][:rows]) ** 2 / 2.0


def mad_std(values: np.ndarray) -> float:
    """Standard deviation (n,) by the median absolute deviation."""
    return float(ROBUST * np.median(np.abs(values - np.median(values))))


def noise_far_below_sensor(comparison: Comparison) -> list[str]:
    """The fast noise of a channel is less than half of the nominal robot's, as in logs that were smoothed."""
    found = []
    for column in comparison.columns:
        channels = [c for c in comparison.of(column) if carries_noise(c)]
        ratios = [fast_noise(c.measured / unit_factor(c)) / fast_noise(c.nominal) for c in channels]
        if ratios and np.median(ratios) < 1.0 / CLEAR:
            found.append(column)
    if not found:
        return []
    return [
        f"fast noise of {few(found)} is less than half of what the robot file says: were the logs smoothed? A fit may "
        "look too good"
    ]


def carries_noise(channel: Channel) -> bool:
    """Whether rounding leaves the noise: more than a step in the nominal log, and most measured samples change."""
    steps = np.abs(np.diff(channel.nominal))
    smallest = steps[steps > EXACT * np.ptp(channel.nominal)].min(initial=np.inf)
    return bool(fast_noise(channel.nominal) > smallest and np.median(np.abs(np.diff(channel.measured))) > 0.0)


def fast_noise(values: np.ndarray) -> float:
    """Standard deviation of white noise in a signal (n,) that moves slowly, by fourth differences; 0 if rounding."""
    found = mad_std(np.diff(values, ORDER)) / np.sqrt(GAIN)
    return 0.0 if found <= np.finfo(float).eps * np.nanmax(np.abs(values), initial=0.0) else found


def moves(values: np.ndarray, rounding: float = 0.0) -> bool:
    """Whether a signal (n,) varies by more than its fast noise and a rounding step [unit of the signal]."""
    return bool(np.ptp(values) > 0.0 and np.std(values) > LEAST_MOTION * max(fast_noise(values), rounding))


def rounding_step(values: np.ndarray) -> float:
    """Smallest change of a rounded signal (n,), whose samples mostly repeat; 0 for another one and for a constant."""
    steps = np.abs(np.diff(values))
    return float(np.min(steps, initial=np.inf, where=steps > 0.0)) if steps.any() and np.median(steps) == 0.0 else 0.0
