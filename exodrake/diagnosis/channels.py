"""Channels that an effect sits on: the set of largest evidence, given its fitted amplitudes.

For a set S of channels the fitted amplitudes x are normal numbers about 0,

    var x = C + (l s)^2 1 + s^2 1_S 1_S' + (c s)^2 1_S      one cause: the channels of S share a value
    var x = C + (l s)^2 1 + s^2 1_S                         each channel of S has a value of its own

s: largest amplitude; C: covariance of the fit; l: share that a wrong law leaks into other channels; c: difference
between channels of one cause. The evidence of S is the mean of both densities. A channel that the motion hardly excites
then follows the others. A test of each channel alone would leave it out.
"""

from __future__ import annotations

import numpy as np

LEAK = 0.12  # of the largest amplitude, into channels without the effect: development cases of the reference simulator
SPREAD = 0.2  # of the largest amplitude, between channels with one cause: as the parameters of two laws differ
ONE_OR_ALL = 0.4  # prior probability of one channel, and of all of them; other sets share what is left: assumed


def affected_channels(x: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Positions of the channels that an effect sits on, in their order; those more surely not 0 come in first.

    A channel whose amplitude ended at 0, a bound, has none, however little its motion tells of it.

    Args:
        x: (channels,) fitted amplitudes.
        covariance: (channels, channels) of x.
    """
    if not np.any(x):
        return np.array([0])
    order = np.argsort(-np.abs(x) / np.sqrt(np.diag(covariance) + (LEAK * np.max(np.abs(x))) ** 2), kind="stable")
    sets = [order[:count] for count in range(1, np.count_nonzero(x) + 1)]
    return np.sort(sets[int(np.argmax([evidence(x, covariance, chosen) for chosen in sets]))])


def evidence(x: np.ndarray, covariance: np.ndarray, chosen: np.ndarray) -> float:
    """Logarithm of the probability density of fitted amplitudes with the effect on the chosen channels."""
    size, there = np.max(np.abs(x)), np.isin(np.arange(len(x)), chosen).astype(float)
    outside = covariance + (LEAK * size) ** 2 * np.eye(len(x))
    one_cause = size**2 * (np.outer(there, there) + SPREAD**2 * np.diag(there))
    of_their_own = size**2 * np.diag(there)
    densities = [log_density(x, outside + inside) for inside in (one_cause, of_their_own)]
    return log_prior(len(chosen), len(x)) + float(np.logaddexp.reduce(densities))


def log_prior(count: int, channels: int) -> float:
    """Logarithm of the prior probability of so many affected channels."""
    if count in (1, channels):
        return float(np.log(ONE_OR_ALL))
    return float(np.log((1.0 - 2.0 * ONE_OR_ALL) / (channels - 2)))


def log_density(x: np.ndarray, covariance: np.ndarray) -> float:
    """Logarithm of a normal density about 0, but for a constant."""
    return float(-0.5 * (x @ np.linalg.solve(covariance, x) + np.linalg.slogdet(covariance)[1]))
