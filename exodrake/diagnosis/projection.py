"""Projection: residuals with the fitted parameters eliminated, and their reduction by one more effect."""

from __future__ import annotations

import numpy as np

from exodrake.core.once import once
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.linearise import Linearisation, Probe
from exodrake.diagnosis.refine import Explanation, whole_jacobian

RIDGE = 1e-9  # relative, on the diagonal of a normal matrix: above rounding


def normal_matrix(columns: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """J'J + P (parameters, parameters) of weighted columns J' (parameters, samples) and prior precisions P."""
    normal = (columns @ columns.T).astype(float) + np.diag(precision)
    return normal + RIDGE * np.diag(np.diag(normal))


def direction_products(likelihood: Likelihood, lin: Linearisation) -> np.ndarray:
    """Products (directions, directions) of weighted directions; those of a view as a whole are made once."""
    if likelihood.counted is not None:
        weighted = lin.directions * likelihood.weights
        return (weighted @ weighted.T).astype(float)
    parts = likelihood.split(lin.directions)
    products = once(lin, "products", lambda: [(part @ part.T).astype(float) for part in parts])
    return np.sum([p / view.scale**2 for p, view in zip(products, likelihood.views, strict=True)], axis=0)


def free(e: Explanation, slope: np.ndarray) -> np.ndarray:
    """Mask (parameters,) of the parameters that are not held by a bound of their tolerance.

    slope: (parameters,) gradient of the cost, which at such a bound falls outwards.
    """
    (low, high), small = e.bounds, 1e-9 * e.prior_std
    held = ((e.x <= low + small) & (slope > 0.0)) | ((e.x >= high - small) & (slope < 0.0))
    return ~held | (np.arange(len(held)) >= e.nominal)


class Projection:
    """Elimination of fitted parameters from residuals, and their reduction by one more effect.

    A nominal parameter that ended at a bound of its tolerance stays there: what it would take up beyond is an effect's.
    """

    def __init__(self, likelihood: Likelihood, e: Explanation, lin: Linearisation) -> None:
        self.explanation, self.likelihood, self.weights = e, likelihood, likelihood.weights
        self.columns, self.precision = whole_jacobian(likelihood, e), 1.0 / e.prior_std**2
        weighted = (self.columns * self.weights).astype(np.float32, copy=False)
        self.free = free(e, weighted @ (e.residual * self.weights) + self.precision * e.x)
        self.fitted = weighted * self.free[:, None]
        self.directions = lin.directions
        self.normal = normal_matrix(self.fitted, self.precision)
        cross = (self.directions @ (self.fitted * self.weights).T).astype(float).T
        self.inverse = np.linalg.inv(self.normal)
        self.solved = self.inverse @ cross
        self.curvature = direction_products(likelihood, lin) - cross.T @ self.solved
        self.probes = [p for p in lin.probes if p.effect not in e.effects]

    def pull(self, rows: np.ndarray, prior: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Weighted rows (n, samples), and the gradient (fitted, n) of half their sum of squares and the prior's.

        `prior` (n, fitted): changes of the parameters in standard deviations of their priors; none if not given.
        """
        rows = (rows * self.weights).astype(np.float32)
        pull = (self.fitted @ rows.T).astype(float)
        return rows, pull if prior is None else pull + (np.sqrt(self.precision) * self.free * prior).T

    def left(self, rows: np.ndarray) -> np.ndarray:
        """Sum of squares (n,) that is left of rows (n, samples)."""
        rows, pull = self.pull(rows)
        return np.einsum("ij,ij->i", rows, rows, dtype=float) - np.einsum("in,in->n", pull, self.inverse @ pull)

    def own(self, row: np.ndarray, effect: str) -> np.ndarray:
        """The part of a row (samples,) that the parameters of all but one effect do not imitate."""
        others = [i for i, p in enumerate(self.explanation.parameters) if p.effect != effect]
        pull = (self.fitted[others] @ (row * self.weights).astype(np.float32)).astype(float)
        return row - np.linalg.solve(self.normal[np.ix_(others, others)], pull) @ self.columns[others]

    def slopes(self, rows: np.ndarray, pull: np.ndarray) -> np.ndarray:
        """Products (directions, n) of the directions with weighted rows (n, samples), the fitted columns eliminated."""
        return (self.directions @ (rows * self.weights).T).astype(float) - self.solved.T @ pull

    def gains(self, rows: np.ndarray) -> np.ndarray:
        """Sum of squares (probes, n) that one more effect takes up of rows (n, samples)."""
        slope = self.slopes(*self.pull(rows))
        return np.array([self.gain(slope, probe) for probe in self.probes])

    def held(self, factor: float) -> np.ndarray:
        """Changes (fitted,) of the parameters by priors of the nominal ones that are so many times as precise."""
        e, precision = self.explanation, self.precision.copy()
        precision[: e.nominal] *= factor
        slope = self.fitted @ (e.residual * self.weights) + precision * e.x
        normal = self.normal + np.diag(precision - self.precision)
        low, high = e.bounds - e.x
        return np.clip(-np.linalg.solve(normal, slope), low, high)

    def moves(self, rows: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Changes (fitted, n) of the parameters by rows (n, samples) of noise, and by errors drawn from the priors."""
        return self.inverse @ self.pull(rows, rng.standard_normal((len(rows), len(self.precision))))[1]

    def retuned(self, rows: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Coordinates (fitted, n) that a fit finds of robots drawn from the priors, by rows (n, samples) of noise."""
        drawn = rng.standard_normal((len(rows), len(self.precision)))  # in standard deviations of the priors
        return drawn.T / np.sqrt(self.precision)[:, None] + self.inverse @ self.pull(rows, -drawn)[1]

    def gain(self, slope: np.ndarray, probe: Probe) -> np.ndarray:
        """Sum of squares (n,) that the directions of a probe take up."""
        normal = self.curvature[np.ix_(probe.rows, probe.rows)]
        normal = normal + 1e-6 * np.diag(np.diag(normal)) + 1e-9 * np.eye(len(normal))
        return np.einsum("in,in->n", slope[probe.rows], np.linalg.solve(normal, slope[probe.rows]))
