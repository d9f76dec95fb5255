"""Logs that hold the same samples, and cases that hold none out."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from exodrake.diagnosis.checks.compare import Comparison

SAME = 0.5  # of a log's windows that are found in another one (assumed)
MATCH = 8  # frames in a row that are compared
FINE = 1e-6  # of a channel's standard deviation: changes closer than this are equal


def nothing_held_out(comparison: Comparison) -> list[str]:
    """A case holds no log out."""
    if comparison.case.holdout_logs:
        return []
    return [f"{comparison.case.name}: no log is held out, so closure cannot be judged on motion the fit never saw"]


def copied_logs(comparison: Comparison) -> list[str]:
    """A log holds samples of another one, or these plus a constant, perhaps cut or shifted."""
    spread = np.std(np.concatenate([pair.measured for pair in comparison.pairs]), axis=0)
    prints = [fingerprints(pair.measured, np.where(spread > 0.0, spread, 1.0)) for pair in comparison.pairs]
    found = []
    for (a, one), (b, other) in combinations(zip(comparison.pairs, prints), 2):
        fewer, more = sorted((one, other), key=len)
        if len(fewer) and np.isin(fewer, more).mean() > SAME:
            roles = "so that nothing new is held out" if a.item.role != b.item.role else "so that it counts twice"
            found.append(f"{b.item.file} holds the samples of {a.item.file} (a constant apart), {roles}")
    return found


def fingerprints(rows: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Hashes of the changes in successive windows of signals (n, channels), motionless windows left out: (windows,)."""
    steps = np.rint(np.diff(rows, axis=0) / (FINE * spread)).astype(np.int64)
    keys = np.random.default_rng(0).integers(1, 2**62, (MATCH, rows.shape[1]), dtype=np.int64) | 1
    windows = len(steps) - MATCH + 1
    hashes = np.sum([steps[k : k + windows] @ keys[k] for k in range(MATCH)], axis=0)
    return np.unique(hashes[hashes != 0])
