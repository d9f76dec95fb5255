"""Logs that seem to come from different robots, or from one that changed between them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from exodrake.diagnosis.checks.compare import Comparison, few, white_share

LEVEL = 1e-3  # of the F test between repeats, over all channels (assumed)
CHANGED = 0.1  # of the motion, by which repeats differ in gain or offset; lost packets and tremor stay below (assumed)
CLOSE = 0.5  # distance at which two states count as one, in standard deviations of the motion (assumed)
SMOOTH = (
    0.01  # white share of a channel up to which it tells the state: its noise moves a state by 0.14, less than CLOSE
)
APART = 1.5  # motions by which a log differs from the others in like states (assumed)
MATCHES = 20  # frames in such states from which the median is taken (assumed)
EVERY = 5  # every fifth frame is compared, for speed


def changed_between_repeats(comparison: Comparison) -> list[str]:
    """Repeats of one reference differ in gain or offset, by an F test and by more than a small part of the motion."""
    pairs = {pair.item.file: pair for pair in comparison.pairs}
    twos = [(pairs[a.file], pairs[b.file]) for g in comparison.case.repeat_groups for a, b in pairwise(g)]
    found: dict[tuple[str, str], list[str]] = {}
    for a, b in twos:
        for i, column in enumerate(comparison.columns):
            change, p = gain_and_offset(a.measured[:, i], b.measured[:, i], a.nominal[:, i])
            if change > CHANGED and p < LEVEL / (len(twos) * len(comparison.columns)):
                found.setdefault((a.item.file, b.item.file), []).append(column)
    return [
        f"{few(columns)} changed in gain or offset from {a} to its repeat {b}: another robot, or one that changed?"
        for (a, b), columns in found.items()
    ]


def gain_and_offset(first: np.ndarray, second: np.ndarray, nominal: np.ndarray) -> tuple[float, float]:
    """Change in gain or offset from one run to its repeat, and the p value of an F test against white noise.

    Args:
        first: (n,) array, a channel in one run.
        second: (m,) array, the same in the other.
        nominal: (n,) array, the same of the nominal robot.

    Returns:
        The larger of both changes, in standard deviations of the motion, and the p value.
    """
    from scipy.special import fdtrc

    n = min(len(first), len(second))
    difference, motion, spread = second[:n] - first[:n], max(np.std(first), np.std(nominal)), np.std(nominal[:n])
    if spread == 0.0 or not difference.any():
        return 0.0, 1.0
    shape = (nominal[:n] - nominal[:n].mean()) / spread
    change = np.array([difference.mean(), (difference * shape).mean()])
    rest = np.sum((difference - change[0] - change[1] * shape) ** 2) / (n - 2)
    p = float(fdtrc(2, n - 2, n * np.mean(change**2) / rest)) if rest > 0.0 else 0.0
    return float(np.abs(change).max() / motion), p


def logs_of_other_robots(comparison: Comparison) -> list[str]:
    """A log differs from the others in states that count as one by more than a channel moves.

    Causes that the diagnosis knows stay below: they act alike in one state, up to its history.
    """
    pairs = comparison.pairs
    reference, measured, nominal = (
        np.concatenate([getattr(pair, name) for pair in pairs]) for name in ("reference", "measured", "nominal")
    )
    log = np.repeat(np.arange(len(pairs)), [len(pair.measured) for pair in pairs])
    smooth = [i for i in range(nominal.shape[1]) if max(map(white_share, (measured[:, i], nominal[:, i]))) < SMOOTH]
    state = np.hstack([reference, nominal[:, smooth]])
    state = state[:, np.ptp(state, axis=0) > 0.0]
    state = state / state.std(axis=0)
    motion = np.maximum(measured.std(axis=0), nominal.std(axis=0))
    found: dict[str, list[str]] = {}
    for k, pair in enumerate(pairs):
        difference = difference_at_same_state(state, measured - nominal, log == k)
        for i in smooth:
            if difference[i] > APART * motion[i]:
                found.setdefault(comparison.columns[i], []).append(pair.item.file)
    return [
        f"{column} of {few(files)} differs from the other logs by more than its motion in like states: another robot?"
        for column, files in found.items()
    ]


def difference_at_same_state(state: np.ndarray, residual: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Median difference of one log's residual from that of the others, frames paired by the nearest state.

    Args:
        state: (n, states) array of all logs, in standard deviations.
        residual: (n, channels) array.
        own: (n,) mask of the one log.

    Returns:
        (channels,) array [SI]; 0 where the states are hardly ever alike.
    """
    from scipy.spatial import KDTree

    mine, others = np.flatnonzero(own)[::EVERY], np.flatnonzero(~own)
    if not len(others) or not state.shape[1]:
        return np.zeros(residual.shape[1])
    distance, nearest = KDTree(state[others]).query(state[mine], distance_upper_bound=CLOSE)
    close = np.isfinite(distance)
    if close.sum() < MATCHES:
        return np.zeros(residual.shape[1])
    return np.abs(np.median(residual[mine[close]] - residual[others[nearest[close]]], axis=0))
