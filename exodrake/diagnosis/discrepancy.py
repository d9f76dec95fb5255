"""Model discrepancy: errors of the laws of an explanation (Kennedy & O'Hagan 2001).

    error = rho c(t) h(state(t))
    h(state) = sum of cosines of the standardised, smoothed columns and their rates

c is the part of an effect's contribution that no other parameter imitates, h a random smooth function of the measured
state, scaled to zero mean and unit variance over the logs of a case.
"""

from __future__ import annotations

from functools import cache, partial

import numpy as np

from exodrake.diagnosis.calibration import Calibration
from exodrake.diagnosis.comparison import residual_contributions, shape_contributions
from exodrake.diagnosis.filters import filled_columns
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.projection import Projection

TYPICAL = 0.5  # error of a law in units of rho: rho is the upper quantile of a normal law at 95 %
FEATURES = 3  # cosines in a function: assumed
STILL = 1e-3  # standard deviation of a function of columns that stand still, which is none: above rounding
SMOOTH = 9  # frames over which the state is averaged: an encoder's step has no rate


class LawErrors:
    """Draws of the errors of the laws of explanations.

    Args:
        likelihood: views of the case.
        moved: (samples,) change of the residual from the nominal to the retuned robot.
        draws: their number.
        calibration: how wrong laws are.
    """

    def __init__(self, likelihood: Likelihood, moved: np.ndarray, draws: int, calibration: Calibration) -> None:
        self.moved, self.draws, self.calibration = moved, draws, calibration
        self.functions = cache(partial(random_functions, likelihood, draws))

    def __call__(self, project: Projection) -> tuple[np.ndarray, np.ndarray]:
        """Draws of the error of the laws at rho, and of the difference between simulators (draws, samples), float32.

        The difference is as large as two simulators of one law show: normal, with the upper quantile `same_meaning`.
        """
        law, model = np.zeros((2, self.draws, len(self.moved)), dtype=np.float32)
        typical = TYPICAL * self.calibration.same_meaning
        sizes = (typical * np.random.default_rng(5).standard_normal(self.draws)).astype(np.float32)
        for k, (contribution, rho) in enumerate(self.contributions(project)):
            for h, size, own, other in zip(self.functions(k), sizes, law, model, strict=True):  # rows stay in the cache
                error = np.multiply(h, contribution, dtype=np.float32)
                own += np.float32(rho) * error
                other += size * error
        return law, model

    def contributions(self, project: Projection) -> list[tuple[np.ndarray, float]]:
        """Contribution of each channel of each effect, and of the change of the nominal parameters.

        Where an amplitude means the same in every law, what shapes the law still belongs to it: a slack wire is as
        long in every law, and comes taut in another way. It is as wrong as any law.

        Returns:
            (samples,) the part of it that no other parameter imitates [noise_std], and rho, the relative standard
            deviation of its law.
        """
        e, likelihood, limits = project.explanation, project.likelihood, self.calibration
        machine, decoded = likelihood.robot.machine, likelihood.views[0].problem.counted
        found = [(self.moved, limits.same_meaning)]
        for identity, rows in residual_contributions(likelihood, e).items():
            rho = limits.rho(machine.effect(identity), decoded)
            found += [(project.own(row, identity), rho) for row in rows]
        for identity, row in shape_contributions(likelihood, e).items():
            found.append((project.own(row, identity), limits.law_error))
        return found


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
