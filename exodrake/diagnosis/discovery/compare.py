"""Levels of a discovery: could noise alone look like it, and could the runner-up have left these logs?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from exodrake.diagnosis.discovery.evidence import Eliminated, information, weights_of
from exodrake.diagnosis.discovery.fit import Fit, Screened
from exodrake.diagnosis.levels import DRAWS, exceeding
from exodrake.diagnosis.likelihood import Likelihood


def gains(model: Eliminated, laws: Sequence[Screened], rows: np.ndarray) -> np.ndarray:
    """Largest sum of squares (n,) that one of the laws takes up of weighted rows (n, samples), scales as found."""
    best = np.zeros(len(rows))
    for s in laws:
        prior = np.maximum(s.weighed.scales, 1.0)[s.channel]
        best = np.maximum(best, model.taken_up(s.columns, prior, s.weighed.variance, rows))
    return best


def level_of_noise(likelihood: Likelihood, model: Eliminated, laws: Sequence[Screened]) -> float:
    """p-value of what the best law takes up, were there noise alone."""
    noise = likelihood.noise_draws(DRAWS, np.random.default_rng(1))
    found = gains(model, laws, model.offset[None])[0]
    return exceeding(gains(model, laws, noise * weights_of(likelihood)), float(found))


def shuffled(likelihood: Likelihood, residual: np.ndarray, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Residuals (draws, samples) as irregular as a given one (samples,): each log turned round, of either sign."""
    logs = [trial.measured.shape for view in likelihood.views for trial in view.problem.fit]
    ends = np.cumsum([rows * columns for rows, columns in logs])[:-1]
    parts = [part.reshape(shape) for part, shape in zip(np.split(residual, ends), logs, strict=True)]
    out = []
    for _ in range(draws):
        turned = [rng.choice((-1.0, 1.0)) * np.roll(p, int(rng.integers(len(p))), axis=0).ravel() for p in parts]
        out.append(np.concatenate(turned))
    return np.array(out, dtype=np.float32)


def log_evidences(fit: Fit, rows: np.ndarray) -> np.ndarray:
    """Log evidence (n,) of weighted rows (n, samples) under a fitted law with its prior scales."""
    model, columns, weighed = fit.model, fit.columns, fit.weighed
    assert model is not None and columns is not None and weighed is not None
    prior = np.maximum(weighed.scales[fit.channel], 1e-6)
    left = np.maximum(model.squares(rows) - model.taken_up(columns, prior, weighed.variance, rows), 0.0)
    variance = np.maximum(left / model.samples, model.least)
    return model.log_evidence(variance, left / variance, information(columns.gram, prior, weighed.variance))


def level_of_runner_up(likelihood: Likelihood, best: Fit, other: Fit) -> float:
    """p-value of the lead of the best law, were the runner-up the truth and the rest as irregular as what is left."""
    assert other.columns is not None and other.weighed is not None and other.model is not None
    assert best.weighed is not None
    rest = shuffled(likelihood, best.residual, DRAWS, np.random.default_rng(2)) * weights_of(likelihood)
    truth = rest - other.weighed.modes.astype(np.float32) @ other.columns.weighted
    leads = log_evidences(best, truth) - log_evidences(other, truth)
    lead = best.weighed.log_evidence - other.weighed.log_evidence
    from scipy.stats import norm

    return float(norm.sf(lead, leads.mean(), max(float(leads.std(ddof=1)), 1e-9)))
