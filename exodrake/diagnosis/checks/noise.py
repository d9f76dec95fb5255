"""Suspicious noise: as large as the motion, above the sensor's, or far below it."""

from __future__ import annotations

from math import comb

import numpy as np

from exodrake.core.display import in_words
from exodrake.core.machine import Machine
from exodrake.diagnosis.checks.compare import Channel, Comparison, few, places, white_share
from exodrake.diagnosis.checks.scale import unit_factor
from exodrake.diagnosis.noise import robust_std

HALF = 0.5  # of the variance: more noise than motion, a signal-to-noise ratio of 1
CLEAR = 2.0  # ratio of standard deviations with p < 1e-3 from 25 independent samples on (F test); of shares: assumed
EXACT = 1e-9  # of a signal's range: smaller steps are rounding of the computer
ABOVE = 1.1  # ratio to the nominal fast noise in every channel of a sensor; healthy robots lie between 0.94 and 1.04
ORDER = 4  # differences that leave noise of what moves slowly (assumed)
NOISIER = "vibration, or noisier sensors"
LEAST_MOTION = 5.0  # motion over noise below which a signal says little: assumed
ORDERS = (8, 16)  # differences that leave little of a loop that hunts: 0.14 and 0.01 of a period of 4 frames
WHITE = 1.2  # ratio of what differences of these orders say of noise that is white (assumed: half of a hunting loop's)


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
        channels = audible(comparison.of(column))
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


def noise_unlike_robot_file(comparison: Comparison) -> list[str]:
    """The fast noise of all channels of a sensor is larger, or less, than the robot file says; what to set then.

    A diagnosis takes the noise of a sensor from the robot file, since what makes a loop hunt is a cause and no noise.
    With a noisier sensor no explanation leaves as little as it should, with a quieter one a fit may look too good.
    """
    if noise_as_large_as_motion(comparison):
        return []
    found: dict[tuple[str, str], dict[str, list[str]]] = {}
    for parameter, columns in noise_parameters(comparison.machine).items():
        shown = [c for c in columns if c in comparison.columns]
        if word := noise_word(comparison, parameter, shown):
            found.setdefault((general(parameter), word), {})[parameter] = shown
    return [noise_sentence(comparison, word, shown) for (_, word), shown in found.items()]


def noise_word(comparison: Comparison, parameter: str, columns: list[str]) -> str:
    """What the noise of the columns of a sensor may be, unless it is as the robot file says or rounding hides it.

    A sensor's noise is in every log; what is fast in one of them alone is its motion. A diagnosis counts the larger of
    noise and repeatability.
    """
    heard, repeats = [audible(comparison.of(column)) for column in columns], repeatability(comparison, parameter)
    if not heard or not all(heard):
        return ""
    simulated = [[noise_of(c) / least_noise(c) for c in channels] for channels in heard]
    counted = [[noise_of(c) / max(least_noise(c), repeats) for c in channels] for channels in heard]
    if min(map(min, counted)) > ABOVE:
        return NOISIER
    if max(map(np.median, simulated)) < 1.0 / ABOVE and min(map(np.median, counted)) < 1.0 / CLEAR:
        return "smoothed logs, or quieter sensors"
    return ""


def logged_noise(comparison: Comparison) -> dict[str, float]:
    """Noise parameters of sensors that are noisier in the logs than the robot file says -> noise that they show [SI].

    It is white, so that differences of two orders say the same of it, and it is in every channel of every log.
    """
    found = {}
    for parameter, columns in noise_parameters(comparison.machine).items():
        shown = [c for c in columns if c in comparison.columns]
        if noise_word(comparison, parameter, shown) != NOISIER:
            continue
        heard = [channel for column in shown for channel in audible(comparison.of(column))]
        high, higher = (np.array([fast_noise(c.measured / unit_factor(c), k) for c in heard]) for k in ORDERS)
        noise, least = np.minimum(high, higher), np.array([least_noise(c) for c in heard])
        if (noise > ABOVE * least).all() and np.median(high / higher) < WHITE:
            found[parameter] = float(np.sqrt(comparison.robot[parameter] ** 2 + np.median(noise**2 - least**2)))
    return found


def general(parameter: str) -> str:
    """A parameter `part.name.channel` without its channel."""
    return ".".join(parameter.split(".")[:2])


def repeatability(comparison: Comparison, parameter: str) -> float:
    """By how much runs differ by the robot file [SI], of the part that a noise parameter is of; 0 for none."""
    name = f"{parameter.split('.')[0]}.repeatability"
    return float(comparison.robot[name]) if name in comparison.machine.index else 0.0


def noise_sentence(comparison: Comparison, word: str, found: dict[str, list[str]]) -> str:
    """What the logs show, what the robot file states, and what to set; found: noise parameters -> their columns."""
    columns, parameter = [column for shown in found.values() for column in shown], next(iter(found))
    same = [p for p in comparison.machine.noise if general(p) == general(parameter)]
    names = general(parameter) if len(found) == len(same) else few(found)
    unit = comparison.machine.signal[comparison.machine.column(columns[0].rsplit("_", 1)[0]).signal].unit
    channels, repeats = audible(comparison.of(columns[0])), repeatability(comparison, parameter)
    logged = in_words(float(np.median([noise_of(c) for c in channels])), unit)
    stated = in_words(float(np.median([fast_noise(c.nominal) for c in channels])), unit)
    also = f"{parameter.split('.')[0]}.repeatability" if repeats else ""
    return (
        f"noise in the logs is {logged} in {few(columns)}, the robot file states {stated}"
        + (f" and {in_words(repeats, unit)} ({also})" if also else "")
        + f": {word}? Set {names}"
        + (f" and {also}" if also else "")
    )


def noise_parameters(machine: Machine) -> dict[str, list[str]]:
    """Noise parameters of sensors -> the columns whose readings they make noisy.

    A parameter `part.name`, or `part.name.channel`, is of the part that writes the readings.
    """
    written = {part.name: {name for output in part.outputs for name in output.writes} for part in machine.parts}
    found: dict[str, list[str]] = {}
    for parameter in machine.noise:
        part, _, *channel = parameter.split(".")
        shown = [c for c in machine.columns if c.signal in written.get(part, ()) and c.kind in machine.compared]
        names = machine.log_names(shown)
        found[parameter] = [n for n in names if not channel or n.endswith(f"_{channel[0]}")]
    return found


def audible(channels: list[Channel]) -> list[Channel]:
    """The channels in which rounding hides neither the nominal noise nor a larger one that is measured."""
    changing = [c for c in channels if np.median(np.abs(np.diff(c.measured))) > 0.0]
    heard = [c for c in changing if least_noise(c) > EXACT * np.ptp(c.measured)]
    return [c for c in heard if carries_noise(c) or fast_noise(c.measured) > ABOVE * least_noise(c)]


def least_noise(channel: Channel) -> float:
    """Nominal fast noise; of a rounded channel two steps, below which rounding may be taken for noise."""
    return max(fast_noise(channel.nominal), CLEAR * rounding_step(channel.nominal))


def noise_of(channel: Channel) -> float:
    """Fast noise of a measured channel in the unit that it seems to have."""
    return fast_noise(channel.measured / unit_factor(channel))


def louder(channel: Channel) -> float:
    """Ratio of the fast noise of a channel to the nominal robot's."""
    return noise_of(channel) / fast_noise(channel.nominal)


def carries_noise(channel: Channel) -> bool:
    """Whether rounding leaves the noise: more than a step in the nominal log, and most measured samples change."""
    steps = np.abs(np.diff(channel.nominal))
    smallest = steps[steps > EXACT * np.ptp(channel.nominal)].min(initial=np.inf)
    return bool(fast_noise(channel.nominal) > smallest and np.median(np.abs(np.diff(channel.measured))) > 0.0)


def fast_noise(values: np.ndarray, order: int = ORDER) -> float:
    """Standard deviation of white noise in a signal (n,) that moves slowly, by differences; 0 if rounding.

    Differences of order k raise white noise by the sum of squared binomial coefficients, (2k over k).
    """
    found = robust_std(np.diff(values, order)) / np.sqrt(comb(2 * order, order))
    return 0.0 if found <= np.finfo(float).eps * np.nanmax(np.abs(values), initial=0.0) else found


def moves(values: np.ndarray, rounding: float = 0.0) -> bool:
    """Whether a signal (n,) varies by more than its fast noise and a rounding step [unit of the signal]."""
    return bool(np.ptp(values) > 0.0 and np.std(values) > LEAST_MOTION * max(fast_noise(values), rounding))


def rounding_step(values: np.ndarray) -> float:
    """Smallest change of a rounded signal (n,), whose samples mostly repeat; 0 for another one and for a constant."""
    steps = np.abs(np.diff(values))
    return float(np.min(steps, initial=np.inf, where=steps > 0.0)) if steps.any() and np.median(steps) == 0.0 else 0.0
