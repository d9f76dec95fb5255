"""Columns in another unit, with the other sign, or exchanged."""

from __future__ import annotations

import numpy as np

from exodrake.core.errors import InputError
from exodrake.diagnosis.checks.compare import Channel, Comparison, few, places

UNITS = (180.0 / np.pi, 100.0, 1000.0)  # degrees in a radian; centi and milli
FACTORS = (-1.0, *(sign * unit**power for unit in UNITS for sign in (1.0, -1.0) for power in (1, -1)))
NEAR = 1.3  # ratio to a factor; geometrically half-way between the two closest ones
ALIKE = 0.9  # correlation from which a channel has the shape of the nominal robot's (assumed)
CLEARLY = 4.0  # ratio of unexplained variances, channel by channel; as a factor of 2 in the residual (assumed)
ANOTHER_UNIT = 10.0**0.5  # times a limit; geometrically half-way to the smallest factor of another decimal unit
EXPLAINED = 0.5  # of the variance of an exchanged channel, by the channel that it seems to be (assumed)


def unit_factor(channel: Channel) -> float:
    """The factor of another unit or sign that a channel seems to carry; 1 for none."""
    spread, nominal = np.std(channel.measured), np.std(channel.nominal)
    if spread == 0.0 or nominal == 0.0:
        return 1.0
    correlation = np.corrcoef(channel.measured, channel.nominal)[0, 1]
    if abs(correlation) < ALIKE:
        return 1.0
    ratio = np.sign(correlation) * spread / nominal
    return next((f for f in FACTORS if 1.0 / NEAR < ratio / f < NEAR), 1.0)


def another_unit(comparison: Comparison) -> list[str]:
    """A channel has the shape of the nominal robot's, times -1, 57.3, 100, 1000 or their inverses."""
    found: dict[float, list[Channel]] = {}
    for channel in comparison.channels:
        if (factor := unit_factor(channel)) != 1.0:
            found.setdefault(factor, []).append(channel)
    return [
        f"{places(channels)} are about {factor:.3g} times what the nominal robot logs: another unit or sign?"
        for factor, channels in found.items()
    ]


def references_beyond_limits(comparison: Comparison) -> list[str]:
    """A command is far beyond the limits that the robot file states."""
    machine = comparison.machine
    unit, found = machine.signal[machine.references[0].signal].unit, []
    for file, columns in beyond_limits(comparison).items():
        worst = max(columns, key=lambda c: columns[c][0] / columns[c][1])
        largest, limit = columns[worst]
        found.append(
            f"{few(columns)} of {file}: another unit than {unit}? "
            f"{worst} reaches {largest:.4g} {unit}, its limit is {limit:.4g} {unit}"
        )
    return found


def beyond_limits(comparison: Comparison) -> dict[str, dict[str, tuple[float, float]]]:
    """File -> command that is far beyond its limit -> largest size and limit [SI]; a measured motion has no limit."""
    machine, found = comparison.machine, {}
    if not (machine.references[0].kind.endswith("_ref") and machine.reference_limits and comparison.robot.limits):
        return {}
    try:
        limits = np.maximum(*map(np.abs, comparison.robot.reference_limits()))
    except InputError:  # not stated for each channel
        return {}
    columns = machine.log_names(machine.references[:1])
    for pair in comparison.pairs:
        largest = np.abs(pair.reference[:, : len(columns)]).max(axis=0)
        sizes = {c: (float(x), float(most)) for c, x, most in zip(columns, largest, limits) if most > 0.0}
        beyond = {c: one for c, one in sizes.items() if one[0] > ANOTHER_UNIT * one[1]}
        found |= {pair.item.file: beyond} if beyond else {}
    return found


def exchanged_columns(comparison: Comparison) -> list[str]:
    """Channels of one kind correlate clearly better with one another's simulation than with their own."""
    found: dict[tuple[str, ...], list[str]] = {}
    for pair in comparison.pairs:
        for indices in comparison.kinds.values():
            better = best_assignment(pair.measured[:, indices], pair.nominal[:, indices])
            moved = [
                (comparison.columns[i], comparison.columns[indices[j]])
                for i, j in zip(indices, better)
                if i != indices[j]
            ]
            if moved:
                sentence = tuple(f"{column} like {other}" for column, other in moved)
                found.setdefault(sentence, []).append(pair.item.file)
    return [f"{few(moved)} of the nominal robot in {few(files)}: exchanged columns?" for moved, files in found.items()]


def best_assignment(measured: np.ndarray, nominal: np.ndarray) -> list[int]:
    """Nominal channel that matches each measured one; its own unless another assignment is clearly better.

    Args:
        measured: (n, channels) array.
        nominal: (n, channels) array.

    Returns:
        Index of a nominal channel for each measured one.
    """
    from scipy.optimize import linear_sum_assignment

    own = list(range(measured.shape[1]))
    if len(own) < 2:
        return own
    unexplained = np.log(unexplained_variance(measured, nominal))
    best = linear_sum_assignment(unexplained)[1]
    moved = np.flatnonzero(best != own)
    if not len(moved):
        return own
    gained = np.mean(unexplained[moved, moved] - unexplained[moved, best[moved]])
    sure = gained > np.log(CLEARLY) and unexplained[moved, best[moved]].max() < np.log(1.0 - EXPLAINED)
    return list(best) if sure else own


def unexplained_variance(measured: np.ndarray, nominal: np.ndarray) -> np.ndarray:
    """Share of measured channels' variance that nominal ones leave with a positive gain: (channels, channels)."""
    a, b = (x - x.mean(axis=0) for x in (measured, nominal))
    scale = np.sqrt(np.outer((a**2).sum(axis=0), (b**2).sum(axis=0)))
    correlation = np.divide(a.T @ b, scale, out=np.zeros_like(scale), where=scale > 0.0)
    return np.clip(1.0 - np.maximum(correlation, 0.0) ** 2, np.finfo(float).eps, 1.0)
