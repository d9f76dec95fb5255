"""Change point of a series: whether a quantity known at several times changed, when and how, by Bayesian evidence.

    y_i = a + b g(t_i) + e_i        e ~ N(0, s^2 V), V known, s >= 1 unknown (sessions scatter more than noise says)

    step   g = 1[t > tau]        ramp   g = max(t - tau, 0)        step and ramp   both at one tau

Shapes and dates are equally likely beforehand, p(a, s) ~ 1/s. b has the g-prior N(0, k s^2 (G'V^-1 G)^-1), G the
columns without their constant (Zellner 1986), k over several decades (Liang et al. 2008). All but shape, date and k is
integrated in closed form. p is the share of series without a change whose odds of one are as large, by draws.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.special import gammainc, gammaincinv, gammaln

from exodrake.core.confidence import ALPHA, CONFIDENCE

STEP, RAMP, BOTH = "step", "ramp", "step and ramp"
LEAST = 5  # points: a change has three parameters, their scatter one
GRID = 4  # dates of a ramp's begin that are tried between two points
SIZES = (1.0, 1e2, 1e4, 1e6)  # k of the prior of b, times the number of points: unit information and wider
DRAWS = 1999  # of series without a change, and of sizes
LARGE = 1e4  # scatter of the series without a change: the bound s >= 1 is far, so that p is the largest
ROUNDING = 1e-6  # of the spread of a series
SMALLEST = 1e-4  # sum of squares beneath which a series counts as exact


@dataclass(frozen=True)
class Change:
    """Change of a series: its date, shape and size, with 90 % intervals."""

    p: float  # p-value of no change
    shape: str  # of the likeliest change
    shapes: tuple[str, ...]  # those of the set of dates
    # (likeliest, low, high) date with its set [unit of times]; one at the first point may be earlier
    began: tuple[float, float, float]
    before: tuple[float, float, float]  # (value, low, high) until then [unit of values]
    after: tuple[float, float, float]  # the same of the last point
    rate: tuple[float, float, float]  # the same by unit of time, from the begin to the last point; NaN of a step
    scatter: float  # s, of the points about the change in units of their own standard deviations
    size: float = 0.0  # log odds of the change [nats]

    def path(self, first: float, last: float) -> list[tuple[float, float]]:
        """Corners (time, value) of the likeliest change between two times."""
        onset, start, end = self.began[0], self.before[0], self.after[0]
        landed = {STEP: end, RAMP: start}.get(self.shape, end - self.rate[0] * (last - onset))
        return [(first, start), (onset, start), (onset, landed), (last, end)]


class ChangePoint:
    """The evidence for one change at increasing times (points,); covariance: (points, points) V of their errors.

    grid: dates of a ramp's begin that are tried between two points.
    """

    def __init__(self, times: np.ndarray, covariance: np.ndarray, grid: int = GRID) -> None:
        self.times = times = np.asarray(times, dtype=float)
        self.white = np.linalg.inv(np.linalg.cholesky(covariance))
        constant = self.white @ np.ones(len(times))
        self.norm = float(np.linalg.norm(constant))
        self.constant = constant / self.norm
        self.half = 0.5 * (len(self.times) - 1)
        # candidates: shape, ends of the time that each stands for, columns. A step lies in any gap between two points.
        # A ramp begins at any point but the last two, and `grid` times between two; a later one equals a step
        found = [(STEP, a, b, times > a, 0.0 * times) for a, b in pairwise(times)]
        for a, b in pairwise(times[:-1]):
            cell = (b - a) / grid
            starts = a + cell * np.arange(grid)
            found += [(RAMP, t - cell / 2, t + cell / 2, np.maximum(times - t, 0.0), 0.0 * times) for t in starts]
        if len(times) > LEAST:  # both together need a point more
            middles = ((a, b, 0.5 * (a + b)) for a, b in pairwise(times[:-1]))
            found += [(BOTH, a, b, times > a, np.maximum(times - t, 0.0)) for a, b, t in middles]
        shape, low, high, *columns = zip(*found, strict=True)
        self.shape, self.low, self.high = np.array(shape), np.array(low), np.array(high)
        self.columns = np.array(columns, dtype=float).transpose(1, 2, 0)  # (candidates, points, 2)
        rows = np.einsum("ij,cjk->cik", self.white, self.columns)
        self.rows = rows - np.einsum("i,j,cjk->cik", self.constant, self.constant, rows)
        q, r = np.linalg.qr(self.rows)  # orthonormal columns of the same span, zeros for one that adds nothing
        size = np.diagonal(r, axis1=1, axis2=2)
        self.added = q * np.where(np.abs(size) > 1e-9, np.sign(size), 0.0)[:, None, :]
        count = 1 + (self.shape == BOTH)
        k = len(self.times) * np.array(SIZES)
        self.kept = k / (1.0 + k)  # (k,) share of a change that the prior lets through
        span, of_shape = self.high - self.low, self.shape[:, None] == self.shape
        prior = np.log(span / (of_shape @ span)) - np.log(len(set(self.shape)) * len(SIZES))
        self.prior = prior - 0.5 * np.log1p(k)[:, None] * count  # (k, candidates), with the volume of b

    def centre(self, series: np.ndarray) -> np.ndarray:
        """Series (points, n), whitened and without their constant."""
        rows = self.white @ series
        return rows - np.outer(self.constant, self.constant @ rows)

    def integrate(self, squares: np.ndarray) -> np.ndarray:
        """Log evidence of residual sums of squares, s >= 1 integrated."""
        half = 0.5 * np.maximum(squares, SMALLEST)
        return gammaln(self.half) + np.log(gammainc(self.half, half)) - self.half * np.log(half)

    def evidences(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Log evidence of centred series (points, n): (n,) without a change, (k, candidates, n) with each."""
        gain = sum((self.added[:, :, c] @ rows) ** 2 for c in (0, 1))
        total = np.sum(rows**2, axis=0)
        each = self.integrate(total - self.kept[:, None, None] * gain) + self.prior[:, :, None]
        return self.integrate(total), each

    @cached_property
    def volume(self) -> float:
        """Log of the density of errors and constant that depends on V alone, for comparisons of several V."""
        return float(np.linalg.slogdet(self.white)[1] - np.log(self.norm))

    def log_odds(self, series: np.ndarray) -> np.ndarray:
        """Log odds (n,) of a change to none in series (points, n), both as likely beforehand [nats]."""
        none, each = self.evidences(self.centre(series))
        return np.logaddexp.reduce(each, axis=(0, 1)) - none

    @cached_property
    def null(self) -> np.ndarray:
        """Log odds (draws,) of series without a change, in order."""
        noise = np.random.default_rng(DRAWS).standard_normal((len(self.times), DRAWS))
        return np.sort(self.log_odds(LARGE * np.linalg.solve(self.white, noise)))

    def p_values(self, series: np.ndarray) -> np.ndarray:
        """p-values (n,) of no change in series (points, n), valid for normal errors of any scatter s >= 1."""
        return (1.0 + DRAWS - np.searchsorted(self.null, self.log_odds(series))) / (DRAWS + 1.0)

    def judge(self, values: np.ndarray, tests: int, p: float | None = None) -> tuple[float, Change | None]:
        """p-value of no change in a series (points,), one of so many tests, and the change where p is below the level.

        p: of this test alone, where it is known.
        """
        p = min(1.0, tests * (float(self.p_values(values[:, None])[0]) if p is None else p))
        return p, self(values, np.random.default_rng(len(values))) if p < ALPHA else None

    def __call__(self, values: np.ndarray, rng: np.random.Generator) -> Change:
        """The change of a series (points,), estimated as if there were one; its sizes are those of the likeliest."""
        rows = self.centre(values[:, None])
        none, each = self.evidences(rows)
        row, weight = rows[:, 0], np.exp(each[:, :, 0] - each.max())
        weight /= weight.sum()
        dates = weight.sum(axis=0)
        order = np.argsort(-dates / (self.high - self.low))
        inside = order[: 1 + int(np.searchsorted(np.cumsum(dates[order]), CONFIDENCE))]
        best = int(order[0])
        began = 0.5 * (self.low[best] + self.high[best]), self.low[inside].min(), self.high[inside].max()
        cloud, scatter, stated = [], [], np.zeros(3)  # of draws: value before, at the last point, rate; s
        draws = rng.multinomial(DRAWS, weight.ravel() / weight.sum()).reshape(weight.shape)
        for c in map(int, np.flatnonzero(draws.sum(axis=0) + (np.arange(weight.shape[1]) == best))):
            own, back = self.added[c].T @ row, np.linalg.pinv(self.rows[c]) @ self.added[c]
            kept = np.repeat(self.kept, draws[:, c])
            squares = np.maximum(row @ row - kept * (own @ own), SMALLEST)
            u = gammaincinv(self.half, rng.random(len(kept)) * gammainc(self.half, 0.5 * squares))
            s = np.maximum(np.sqrt(squares / (2.0 * np.maximum(u, 1e-300))), 1.0)
            noise = rng.standard_normal((len(kept), 3)) * s[:, None]
            b = (kept[:, None] * own + np.sqrt(kept)[:, None] * noise[:, 1:]) @ back.T
            cloud.append(self.find_sizes(c, values, b, noise[:, 0]))
            scatter.append(s)
            if c == best:
                mean = float(weight[:, c] @ self.kept / weight[:, c].sum()) * own @ back.T
                stated = self.find_sizes(c, values, mean[None], np.zeros(1))[0]
        stated = np.where(np.abs(stated) < ROUNDING * np.ptp(values), 0.0, stated)
        sizes = []
        for value, column in zip(stated, np.concatenate(cloud).T, strict=True):
            low, high, known = np.nan, np.nan, column[np.isfinite(column)]
            if np.isfinite(value) and len(known):
                low, high = np.quantile(known, [0.5 - CONFIDENCE / 2, 0.5 + CONFIDENCE / 2])
                low, high = min(low, value), max(high, value)
            sizes.append((float(value), float(low), float(high)))
        before, after, rate = sizes
        return Change(
            p=float(self.p_values(values[:, None])[0]), shape=str(self.shape[best]),
            shapes=tuple(dict.fromkeys(map(str, self.shape[inside]))),
            began=tuple(float(max(t, self.times[0])) for t in began),  # pyright: ignore[reportArgumentType]
            before=before, after=after, rate=rate, scatter=float(np.concatenate(scatter).mean()),
            size=float(np.logaddexp.reduce(each, axis=None) - none[0]),
        )  # fmt: skip

    def find_sizes(self, c: int, values: np.ndarray, b: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """Value before, at the last point, and rate (n, 3), of coefficients b (n, 2) of a candidate and noise (n,)."""
        left = self.white @ (values[:, None] - self.columns[c] @ b.T)
        first = (self.constant @ left + noise) / self.norm
        rate = {STEP: np.full(len(b), np.nan), RAMP: b[:, 0], BOTH: b[:, 1]}[str(self.shape[c])]
        return np.column_stack([first, first + b @ self.columns[c, -1], rate])
