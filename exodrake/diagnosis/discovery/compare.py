"""Comparisons of a discovery: with noise alone, and with the runner-up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from exodrake.diagnosis.discovery.evidence import Eliminated, weights_of
from exodrake.diagnosis.discovery.fit import Screened
from exodrake.diagnosis.levels import DRAWS
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.p_values import exceeding

# in 90 % of robots a law in a wrong part takes up less of what the best one in the right part leaves: conformal
# quantile of 24 of the reference simulator, rounded up (docs/missing_law.md); the largest are 0.65, 0.49 and 0.05
LEAD = 0.5


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


def lead(share: float, other: float) -> float:
    """Share of what another law leaves above noise that a law takes up; both of which remove a share of the excess.

    A share below 0 is that of a fit that ended early: with no law at all it is 0.
    """
    return 1.0 - (1.0 - share) / max(1.0 - max(other, 0.0), 1e-9)
