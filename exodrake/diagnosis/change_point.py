"""Change point of a series: whether a quantity that was estimated session by session changed, when and how.

    y_i = a + b g(t_i) + e_i        e ~ N(0, s^2 V), V known, s >= 1 unknown (sessions scatter more than noise says)

    step   g = 1[t > tau]        ramp   g = max(t - tau, 0)        step and ramp   both at one tau

The statistic is the largest likelihood ratio over shape and date, a scan (Quandt 1960; Andrews 1993; Bai & Perron
1998; for a step on line Page's CUSUM 1954, Siegmund 1985). Its law without a change depends neither on a nor on s, so
draws of white noise give exact p-values. The confidence set of the date inverts the ratio test: a date is kept if
series that change then, as fitted, come out as far below their best date often enough (Worsley 1986). Draws replace
the asymptotics of smooth likelihoods, which do not hold for change points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from exodrake.core.confidence import ALPHA, CONFIDENCE
from exodrake.diagnosis.change_dates import BOTH, RAMP, STEP, Dates, dates_of

LEAST = 5  # points: a change has three parameters, their scatter one
REJECTED = 0.05  # level of a date's test: at a tenth, sets of ramps covered 82 to 88 %, since sizes are fitted, too
DRAWS, DATE_DRAWS, SIZE_DRAWS = 1999, 199, 2000  # for the p-value, for each date that is tried, for sizes
GRID = 4  # dates of a ramp's begin that are tried between two points
ROUNDING = 1e-9  # of the spread of a series
FAR = 40.0  # deviance beyond which a date is given up without draws: no level between 1e-9 and 0.5 has such a limit


@dataclass(frozen=True)
class Change:
    """Change of a series: its date, shape and size, with intervals.

    Attributes:
        p: p-value of no change.
        shape: of the likeliest change.
        shapes: those that the series leaves open.
        began: (likeliest, low, high) date with its 90 % set [unit of times]; one at the first point may be earlier.
        before: (value, low, high) until then [unit of values].
        after: the same of the last point.
        rate: the same by unit of time, from the begin to the last point; NaN of a step.
        scatter: s, the scatter of the points about the change in units of their own standard deviations.
        size: sum of squares that the change takes up, in units of s^2.
    """

    p: float
    shape: str
    shapes: tuple[str, ...]
    began: tuple[float, float, float]
    before: tuple[float, float, float]
    after: tuple[float, float, float]
    rate: tuple[float, float, float]
    scatter: float
    size: float = 0.0

    def path(self, first: float, last: float) -> list[tuple[float, float]]:
        """Corners (time, value) of the likeliest change between two times."""
        onset, start, end = self.began[0], self.before[0], self.after[0]
        landed = {STEP: end, RAMP: start}.get(self.shape, end - self.rate[0] * (last - onset))
        return [(first, start), (onset, start), (onset, landed), (last, end)]


class ChangePoint:
    """The scan for one change at times (points,), of series with one covariance (points, points) of their errors."""

    def __init__(self, times: np.ndarray, covariance: np.ndarray, grid: int = GRID) -> None:
        self.times = np.asarray(times, dtype=float)
        self.white = np.linalg.inv(np.linalg.cholesky(covariance))
        constant = self.white @ np.ones(len(times))
        self.constant = constant / np.linalg.norm(constant)
        self.all = dates_of(self.times, self.white, self.constant, grid)
        self.plain = self.all.where(self.all.shape != BOTH)  # one parameter each, so their gains compare

    @cached_property
    def null(self) -> np.ndarray:
        """Likelihood ratios (draws,) of series without a change, whose scatter is not known."""
        noise = np.random.default_rng(DRAWS).standard_normal((len(self.times), DRAWS))
        return np.sort(self.ratio(noise - np.outer(self.constant, self.constant @ noise), 0.0))

    def centred(self, series: np.ndarray) -> np.ndarray:
        """Series (points, n), whitened and without their constant."""
        rows = self.white @ series
        return rows - np.outer(self.constant, self.constant @ rows)

    def ratio(self, rows: np.ndarray, least: float) -> np.ndarray:
        """Largest likelihood ratio (n,) of centred series (points, n), the scatter's square being `least` at least."""
        gain, free = self.plain.gains(rows).max(axis=0), max(len(rows) - 2, 1)
        left = np.maximum((rows**2).sum(axis=0) - gain, 1e-12)
        return gain / np.maximum(left / free, least)

    def p_values(self, series: np.ndarray) -> np.ndarray:
        """p-values (n,) of no change in series (points, n), valid for normal errors of any scatter s >= 1."""
        above = DRAWS - np.searchsorted(self.null, self.ratio(self.centred(series), 1.0))
        return (1.0 + above) / (DRAWS + 1.0)

    def __call__(self, values: np.ndarray, rng: np.random.Generator) -> Change:
        """The change of a series (points,), with date, shape and sizes estimated as if there were one."""
        p, row = float(self.p_values(values[:, None])[0]), self.centred(values[:, None])
        dates = self.all if self.needs_both(row, rng) else self.plain
        gain = dates.gains(row)[:, 0]
        best = int(gain.argmax())
        free = max(len(row) - 3 - int(dates.shape[best] == BOTH), 1)  # constant, date and sizes are fitted
        scatter = max(float(np.sum(row**2) - gain[best]) / free, 1.0)
        kept = self.dates_left(dates, row, gain, scatter, free, rng)
        weight = np.where(kept, np.exp(-(gain[best] - gain) / (2.0 * scatter)), 0.0)
        sizes = self.sizes(dates, values, weight / weight.sum(), scatter, free, rng)
        middle = 0.5 * (dates.low[best] + dates.high[best])
        ends = (dates.low[kept].min(), dates.high[kept].max())
        began = tuple(float(max(t, self.times[0])) for t in (middle, *ends))
        shapes = tuple(dict.fromkeys([str(dates.shape[best]), *map(str, dates.shape[kept])]))
        before, after, rate = sizes
        name, strength = str(dates.shape[best]), float(gain[best] / scatter)
        return Change(p, name, shapes, began, before, after, rate, float(np.sqrt(scatter)), strength)  # pyright: ignore

    def needs_both(self, row: np.ndarray, rng: np.random.Generator) -> bool:
        """Whether one of step and ramp alone is rejected against both, by draws of the likelier one as fitted."""
        if len(row) <= LEAST:
            return False
        gain, total = self.plain.gains(row)[:, 0], float(np.sum(row**2))
        best, free = int(gain.argmax()), len(row) - 3
        fitted = self.plain.added[best] @ (self.plain.added[best].T @ row)
        scatter = max((total - gain[best]) / free, 1.0)
        drawn = fitted + np.sqrt(scatter) * self.noise(rng)

        def ratio(rows: np.ndarray, least: float) -> np.ndarray:
            one, two = self.plain.gains(rows).max(axis=0), self.all.gains(rows).max(axis=0)
            return (two - one) / np.maximum(((rows**2).sum(axis=0) - two) / (free - 1), least)

        above = int((ratio(drawn, 1e-12) >= ratio(row, 1.0)).sum())
        return (1.0 + above) / (DATE_DRAWS + 1.0) < ALPHA

    def noise(self, rng: np.random.Generator) -> np.ndarray:
        """White noise (points, draws) without its constant."""
        noise = rng.standard_normal((len(self.times), DATE_DRAWS))
        return noise - np.outer(self.constant, self.constant @ noise)

    def dates_left(
        self, dates: Dates, row: np.ndarray, gain: np.ndarray, scatter: float, free: int, rng: np.random.Generator
    ) -> np.ndarray:
        """Candidates that the likelihood ratio test does not reject.

        Args:
            dates: what is tried.
            row: (points, 1) centred series.
            gain: (candidates,) sum of squares that each takes up of it.
            scatter: s^2 about the best one [-].
            free: degrees of freedom of s^2.
            rng: of the draws.

        Returns:
            (candidates,) mask.
        """
        deviance = (gain.max() - gain) / scatter
        kept = deviance <= 0.0
        noise = self.noise(rng)
        for k in np.flatnonzero((deviance > 0.0) & (deviance <= FAR)):
            spread = max(float(np.sum(row**2) - gain[k]) / (len(row) - 2), 1.0)
            rows = dates.added[k] @ (dates.added[k].T @ row) + np.sqrt(spread) * noise
            drawn = dates.gains(rows)
            best = drawn.max(axis=0)
            left = (rows**2).sum(axis=0) - best
            below = (best - drawn[k]) / np.maximum(left / free, 1e-12)
            kept[k] = (1.0 + (below >= deviance[k]).sum()) / (DATE_DRAWS + 1.0) > REJECTED
        return kept

    def sizes(
        self, dates: Dates, values: np.ndarray, weights: np.ndarray, scatter: float, free: int, rng: np.random.Generator
    ) -> list[tuple[float, float, float]]:
        """Value before, value at the last point, and rate, each with its interval, averaged over the dates left.

        Args:
            dates: what is tried.
            values: (points,) series.
            weights: (candidates,) of the dates.
            scatter: s^2 [-].
            free: degrees of freedom of s^2.
            rng: of the draws.
        """
        counts, cloud = rng.multinomial(SIZE_DRAWS, weights), []
        for k in map(int, np.flatnonzero(counts)):
            mean, spread = self.fit(dates, k, values)
            strength = np.sqrt(scatter * free / rng.chisquare(free, counts[k]))
            moves = rng.multivariate_normal(np.zeros(3), spread, counts[k], method="eigh")
            cloud.append(stated(dates, k, mean + strength[:, None] * moves))
        best = int(weights.argmax())
        first, rows = stated(dates, best, self.fit(dates, best, values)[0][None])[0], np.concatenate(cloud)
        first = np.where(np.abs(first) < ROUNDING * np.ptp(values), 0.0, first)
        return [interval_of(value, column) for value, column in zip(first, rows.T, strict=True)]

    def fit(self, dates: Dates, k: int, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients (3,) of a constant and of the candidate's columns, and their covariance (3, 3) for s = 1."""
        design = self.white @ np.column_stack([np.ones(len(self.times)), dates.columns[k]])
        spread = np.linalg.pinv(design.T @ design)
        return spread @ design.T @ (self.white @ values), spread


def stated(dates: Dates, k: int, coefficients: np.ndarray) -> np.ndarray:
    """Value before, at the last point, and rate (n, 3), of coefficients (n, 3) of candidate k; no rate of a step."""
    after = coefficients[:, 0] + coefficients[:, 1:] @ dates.columns[k, -1]
    rate = {STEP: np.full(len(after), np.nan), RAMP: coefficients[:, 1], BOTH: coefficients[:, 2]}[str(dates.shape[k])]
    return np.column_stack([coefficients[:, 0], after, rate])


def interval_of(value: float, draws: np.ndarray) -> tuple[float, float, float]:
    """A value with the ends of its 90 % interval by draws (n,), which may be NaN."""
    known = draws[np.isfinite(draws)]
    if not np.isfinite(value) or not len(known):
        return float("nan"), float("nan"), float("nan")
    low, high = np.quantile(known, [0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2])
    return float(value), float(min(low, value)), float(max(high, value))
