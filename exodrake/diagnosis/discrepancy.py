"""Model discrepancy: random smooth functions of the measured state as the error of an effect's law.

    h(state) = sum of cosines of the standardised, smoothed columns and their rates

scaled to zero mean and unit variance over the logs of a case.
"""

from __future__ import annotations

import numpy as np

from exodrake.diagnosis.filters import filled_columns
from exodrake.diagnosis.likelihood import Likelihood

FEATURES = 3  # cosines in a function: assumed
STILL = 1e-3  # standard deviation of a function of columns that stand still, which is none: above rounding
SMOOTH = 9  # frames over which the state is averaged: an encoder's step has no rate


def random_functions(likelihood: Likelihood, draws: int, seed: int) -> np.ndarray:
    """Random smooth functions of the measured state (draws, samples), zero mean, unit variance, alike in all columns.

    The state is every measured column and its rate, standardised over the logs.
    """
    rng = np.random.default_rng(seed)
    slopes, phases = rng.normal(0.0, 1.5, (draws, FEATURES)), rng.uniform(0.0, 2.0 * np.pi, (draws, FEATURES))
    states = [state(trial.measured) for trial in likelihood.views[0].problem.fit]
    whole = np.concatenate(states)
    mean, std = whole.mean(axis=0), np.maximum(whole.std(axis=0), 1e-12)
    picks = rng.integers(0, whole.shape[1], (draws, FEATURES))
    smooth, parts = [], []
    for s in states:
        h = np.cos(slopes[:, :, None] * ((s - mean) / std).T[picks] + phases[:, :, None]).sum(axis=1)
        smooth.append(h.astype(np.float32))
    joined = np.concatenate(smooth, axis=1)
    shift, scale = joined.mean(axis=1, keepdims=True), np.maximum(joined.std(axis=1, keepdims=True), STILL)
    for view in likelihood.views:
        for trial, h in zip(view.problem.fit, smooth, strict=True):
            parts.append(np.repeat((h - shift) / scale, trial.measured.shape[1], axis=1))
    return np.concatenate(parts, axis=1)


def state(measured: np.ndarray) -> np.ndarray:
    """Smoothed columns and their rates (frames, 2 columns) of a log (frames, columns)."""
    from scipy.ndimage import uniform_filter1d

    smooth = uniform_filter1d(filled_columns(measured), SMOOTH, axis=0, mode="nearest")
    return np.concatenate([smooth, np.gradient(smooth, axis=0)], axis=1)
