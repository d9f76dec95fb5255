"""Change point of a series whose errors are autocorrelated, as a gap is that follows the motion.

    y_i = a + b g(t_i) + e_i        cov(e_i, e_j) = s^2 rho^|t_i - t_j| / (1 - rho^2), s and rho unknown

The statistic is the likelihood ratio with rho profiled with and without a change. Draws of the series without one, with
rho as fitted there, give its p-value (parametric bootstrap; Davison & Hinkley 1997, ch. 4).
"""

from __future__ import annotations

import numpy as np

from exodrake.diagnosis.change_point import ChangePoint

CORRELATIONS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)  # of neighbours, that are tried
MOST = 0.97  # that draws have: beyond it a minute of seconds is one sample
DRAWS = 199
TINY = 1e-6  # standard deviation below any scatter, which is then estimated alone


class AutocorrelatedChange:
    """The scan for one change at times (points,), `step` apart where none is missing."""

    def __init__(self, times: np.ndarray, step: float) -> None:
        self.lags = np.abs(np.subtract.outer(times, times)) / step
        covariances = [self.covariance(rho) for rho in CORRELATIONS]
        self.scans = [ChangePoint(times, TINY**2 * matrix, grid=1) for matrix in covariances]
        self.logs = [0.5 * float(np.linalg.slogdet(matrix)[1]) for matrix in covariances]

    def covariance(self, rho: float) -> np.ndarray:
        """Covariance (points, points) of the errors for s = 1."""
        return rho**self.lags / (1.0 - rho**2)

    def likelihoods(self, series: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Log likelihoods (correlations, n) of series (points, n) without and with a change."""
        found = []
        for scan, log in zip(self.scans, self.logs, strict=True):
            rows = scan.centred(series)
            total = np.sum(rows**2, axis=0)
            left = np.maximum([total, total - scan.plain.gains(rows).max(axis=0)], 1e-12)
            found.append(-0.5 * len(rows) * np.log(left) - log)
        without, with_one = np.array(found).transpose(1, 0, 2)
        return without, with_one

    def __call__(self, values: np.ndarray, rng: np.random.Generator) -> tuple[float, ChangePoint]:
        """p-value of no change in values (points,), and the scan with the correlation that fits with one."""
        without, with_one = self.likelihoods(values[:, None])
        rho, points = CORRELATIONS[int(without.argmax())], len(values)
        rho = min(rho + (1.0 + 3.0 * rho) / points, MOST)  # an estimate is too small by so much (Kendall 1954)
        drawn = np.linalg.cholesky(self.covariance(rho)) @ rng.standard_normal((points, DRAWS))
        none, one = self.likelihoods(drawn)
        above = int(np.sum(one.max(axis=0) - none.max(axis=0) >= with_one.max() - without.max()))
        return (1.0 + above) / (DRAWS + 1.0), self.scans[int(with_one.argmax())]
