"""p-values of sums of squares by draws of what an explanation may leave, each alone or several tested jointly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from exodrake.diagnosis.comparison import power
from exodrake.diagnosis.likelihood import Likelihood


def exceeding(draws: np.ndarray, value: float) -> float:
    """p-value of a value under the draws (n,) of its null, log-normal, so that it may be smaller than 1 / n."""
    from scipy.stats import norm

    logs = np.log(np.maximum(draws, 1e-12))
    return float(norm.sf(np.log(max(value, 1e-12)), logs.mean(), max(logs.std(ddof=1), 1e-12)))


def exceeding_any(draws: Sequence[np.ndarray], values: Sequence[float]) -> list[float]:
    """p-values of several statistics that are tested jointly, so that the smallest of them keeps its level.

    Statistics of one residual depend on each other and count as fewer (effective number of tests; Nyholt 2004). By
    Sidak (1967) 1 - (1 - p)^k is uniform of the smallest p of k independent ones; k is its maximum-likelihood estimate
    from the draws.

    Args:
        draws: (n,) of each statistic under its null, of the same draws.
        values: of each statistic.
    """
    from scipy.stats import norm

    logs, found = (np.log(np.maximum(np.asarray(some, float), 1e-12)) for some in (draws, values))
    mean, spread = logs.mean(axis=1), np.maximum(logs.std(axis=1, ddof=1), 1e-12)
    least = norm.sf((logs.T - mean) / spread).min(axis=1)
    single = norm.sf((found - mean) / spread)
    drawn, own = (np.log1p(-np.minimum(p, 1.0 - 1e-12)) for p in (least, single))
    count = np.clip(-1.0 / np.mean(drawn), 1.0, len(logs))
    return (-np.expm1(count * own)).tolist()


class ViewNull(NamedTuple):
    """Sums of squares (draws,) that each view of an explanation at its true parameters may leave."""

    likelihood: Likelihood
    draws: list[np.ndarray]

    @staticmethod
    def of(likelihood: Likelihood, noise: np.ndarray, law: np.ndarray) -> ViewNull:
        """From draws (draws, samples) of noise and of errors of the laws."""
        parts = zip(likelihood.split(noise), likelihood.split(law), strict=True)
        return ViewNull(likelihood, [power(w) + power(error) for w, error in parts])

    def p_values(self, residual: np.ndarray, *more: tuple[np.ndarray, float]) -> list[float]:
        """p-values of the views of a residual (samples,), and of more statistics: draws and value; tested jointly."""
        found = zip(self.draws, map(power, self.likelihood.split(residual)), strict=True)
        return exceeding_any(*zip(*found, *more, strict=True))
