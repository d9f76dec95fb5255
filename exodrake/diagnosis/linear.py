"""The linear-Gaussian model of a case about a fit; every use of it is a sum of blocks of one matrix.

    r = r0 + J x + e          x ~ N(m, P^-1)          e ~ N(0, s_v^2) in view v, one sample in so many independent

r0 is the whitened residual at a fit, x the change of its parameters from there. All that is asked of the model follows
from the products of [J; r0] with itself: they are kept by block, a stretch of one log in one view, so that any part of
the logs can be left out by subtraction. s_v^2 is what the fit leaves in a view, noise (1) at least.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from exodrake.diagnosis.fit import Explanation

RIDGE = 1e-9  # relative, on the diagonal of a normal matrix: above rounding


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Products of Jacobian and residual by block, with priors and bounds."""

    products: np.ndarray  # (blocks, p + 1, p + 1) of the p rows of J and, last, r0 with each other
    samples: np.ndarray  # (blocks,) number of samples
    view: np.ndarray  # (blocks,) that a block belongs to
    log: np.ndarray  # (blocks,) that a block belongs to; blocks of a log follow each other
    mean: np.ndarray  # (p,) prior mean of x
    precision: np.ndarray  # (p,) prior precision of x
    low: np.ndarray  # (p,) bound of x
    high: np.ndarray  # (p,) bound of x
    variance: np.ndarray  # (views,) s_v^2
    memory: float  # samples that count as one

    @classmethod
    def of_rows(
        cls, rows: np.ndarray, blocks: Sequence[tuple[int, int, slice | np.ndarray]], prior: Sequence[np.ndarray],
        memory: float,
    ) -> LinearModel:  # fmt: skip
        """The model of weighted rows (p + 1, samples), Jacobian and, last, residual.

        blocks: view, log and samples of each. prior: mean, precision, low and high (p,) of x.
        """
        parts = [rows[:, place] for _, _, place in blocks]
        products = np.array([part @ part.T for part in parts], dtype=float)
        samples = np.array([part.shape[1] for part in parts], dtype=float)
        view, log = (np.array([block[k] for block in blocks]) for k in (0, 1))
        chi2 = [products[view == v, -1, -1].sum() / samples[view == v].sum() for v in range(view.max() + 1)]
        mean, precision, low, high = prior
        return cls(products, samples, view, log, mean, precision, low, high, np.maximum(chi2, 1.0), memory)

    @classmethod
    def with_directions(
        cls, e: Explanation, columns: np.ndarray, directions: np.ndarray,
        blocks: Sequence[tuple[int, int, slice | np.ndarray]], memory: float, precision: float = 0.0,
        kept: np.ndarray | float = 1.0,
    ) -> LinearModel:  # fmt: skip
        """The model of the parameters of an explanation and, after them, of free factors of further directions.

        columns: (parameters, samples) its Jacobian. directions: (directions, samples) residual with one more thing,
        less that without it. precision: prior precision of the factors. kept: (samples,) mask of those that count.
        """
        flat, (low, high) = np.zeros(len(directions)), e.bounds - e.x
        ends = np.r_[low, flat - np.inf], np.r_[high, flat + np.inf]
        prior = (np.r_[-e.x, flat], np.r_[1.0 / e.prior_std**2, flat + precision], *ends)
        rows = np.concatenate([columns, directions, e.residual[None].astype(directions.dtype)]) * kept
        return cls.of_rows(rows, blocks, prior, memory)

    @property
    def effective(self) -> np.ndarray:
        """Independent samples (views,)."""
        return np.array([self.samples[self.view == v].sum() for v in range(len(self.variance))]) / self.memory

    def weight_products(self, blocks: np.ndarray | None = None) -> np.ndarray:
        """Weighted products (p + 1, p + 1) of all blocks, or of those in a mask (blocks,)."""
        weight = 1.0 / (self.memory * self.variance[self.view])
        return np.einsum("b,bij->ij", weight if blocks is None else weight * blocks, self.products)

    def posterior(self, blocks: np.ndarray | None = None) -> Posterior:
        """The posterior of x by all blocks, or by those in a mask (blocks,)."""
        products = self.weight_products(blocks)
        normal = products[:-1, :-1] + np.diag(self.precision)
        scale = np.sqrt(np.diag(normal))
        unit = normal / np.outer(scale, scale) + RIDGE * np.eye(len(scale))
        slope = products[:-1, -1] - self.precision * self.mean
        step, _ = minimise_bounded(normal, slope, self.low, self.high)
        both = np.r_[step, 1.0]
        cost = both @ products @ both + self.precision @ (step - self.mean) ** 2
        volume = np.linalg.slogdet(unit)[1] + 2.0 * np.log(scale).sum() - np.log(self.precision).sum()
        return Posterior(step, np.linalg.inv(unit) / np.outer(scale, scale), float(cost), float(volume))

    def robust_covariance(self) -> np.ndarray:
        """Covariance (p, p) of x at a fit: that of the posterior, wider where stretches of the logs contradict it.

            S = H^-1 (P + sum_s g_s g_s') H^-1          g_s: slope of the cost by one stretch of a log, in all views

        S also holds where a model errs, by more in some motion than in other (White 1980; Liang & Zeger 1986). Each
        standard deviation is the larger one of both.
        """
        own, normal = self.posterior().covariance, replace(self, memory=1.0).posterior().covariance
        _, first, series = np.unique(np.stack([self.view, self.log]), axis=1, return_index=True, return_inverse=True)
        turn = np.arange(len(self.log)) - first[series]
        _, stretch = np.unique(np.stack([self.log, turn]), axis=1, return_inverse=True)
        slopes = np.zeros((stretch.max() + 1, len(own)))
        np.add.at(slopes, stretch, self.products[:, :-1, -1] / self.variance[self.view, None])
        if len(slopes) < 2:
            return own
        scatter = len(slopes) * np.cov(slopes, rowvar=False).reshape(own.shape)
        robust = normal @ (scatter + np.diag(self.precision)) @ normal
        wider = np.sqrt(np.maximum(np.diag(robust) / np.diag(own), 1.0))
        return own * np.outer(wider, wider)

    def evidence(self, memory: float | None = None) -> float:
        """Logarithm of the probability of the logs (marginal likelihood), but for a constant; in nats."""
        model = self if memory is None else replace(self, memory=memory)
        found = model.posterior()
        return -0.5 * (float(model.effective @ np.log(model.variance)) + found.cost + found.volume)

    def eliminate(self, count: int, blocks: np.ndarray | None = None) -> Reduced:
        """The model of the last x alone, the first `count` of them eliminated (Schur complement).

        By all blocks, or by those in a mask (blocks,).

        A parameter with a prior that ended at a bound of it stays there: what it would take up beyond is another's.
        """
        products = self.weight_products(blocks)
        slope = products[:count, -1] - self.precision[:count] * self.mean[:count]
        small = 1e-9 / np.sqrt(self.precision[:count])
        free = ~(((self.low[:count] >= -small) & (slope > 0.0)) | ((self.high[:count] <= small) & (slope < 0.0)))
        normal = products[:count, :count] + np.diag(self.precision[:count])
        normal = normal * np.outer(free, free) + np.diag(np.where(free, RIDGE * np.diag(normal), 1.0))
        cross, slope = products[:count, count:-1] * free[:, None], slope * free
        solved = np.linalg.solve(normal, np.column_stack([cross, slope]))
        own = products[count:-1, count:-1] - cross.T @ solved[:, :-1]
        return Reduced(own, products[count:-1, -1] - cross.T @ solved[:, -1], solved)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Change of the parameters that a model expects."""

    step: np.ndarray  # (p,) mean, within bounds
    covariance: np.ndarray  # (p, p)
    cost: float  # weighted sum of squares at the mean, the prior's included
    volume: float  # logarithm of the determinant of posterior over prior precision


@dataclass(frozen=True, eq=False)
class Reduced:
    """A cost f's + f'Nf / 2 of some x, the others eliminated."""

    normal: np.ndarray  # (d, d) N
    slope: np.ndarray  # (d,) s
    solved: np.ndarray  # (eliminated, d + 1) minus the change of the others by each f, and by none

    def others(self, rows: np.ndarray, f: np.ndarray) -> np.ndarray:
        """Change (eliminated,) of the eliminated x with f (rows,) at some places."""
        return -(self.solved[:, -1] + self.solved[:, rows] @ f)


def minimise_bounded(
    normal: np.ndarray, slope: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, float]:
    """Minimiser (n,) of f's + f'Nf / 2 within bounds, and the minimum (active set; Stark & Parker 1995)."""
    from scipy.optimize import lsq_linear

    if not len(slope):
        return slope, 0.0
    own = np.maximum(np.diag(normal), 1e-12)
    least = np.where(own[:, None] > own, normal**2 / own[:, None], 0.0)  # less than this is rounding
    size = np.sqrt(np.maximum(own, least.max(axis=0, initial=0.0)))
    unit = normal / np.outer(size, size)
    np.fill_diagonal(unit, 1.0)
    values, vectors = np.linalg.eigh(unit)
    factor = np.sqrt(np.maximum(values, 1e-8 * max(1.0, values[-1])))[:, None] * vectors.T
    scaled = factor.T @ factor
    target = np.linalg.solve(factor.T, -slope / size)
    found = np.linalg.solve(factor, target)
    ends = low * size, np.maximum(high * size, np.nextafter(low * size, np.inf))
    if np.any((found < ends[0]) | (found > ends[1])):
        found = lsq_linear(factor, target, ends, method="bvls").x
    return found / size, float(0.5 * found @ scaled @ found + (slope / size) @ found)
