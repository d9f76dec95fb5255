"""Marginal likelihood of a free law: linear weights with a normal prior beside nuisance parameters.

    r = r0 + J x + F c          x ~ N(0, P^-1)          c_i ~ N(0, s_channel^2)          residual ~ N(0, v) a sample

x is eliminated (Schur complement). The scale s of each channel and the variance v are those of the largest evidence
(MacKay, Neural Computation 4(3), 1992); a channel that the logs do not need gets s = 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from exodrake.diagnosis.likelihood import CORRELATION, SAMPLE, Likelihood
from exodrake.diagnosis.projection import normal_matrix

SCALES = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)  # of a law in units of its plausible size
PASSES, ROUNDS = 2, 4  # over the channels; of the residual's variance


def weights_of(likelihood: Likelihood) -> np.ndarray:
    """Weight of each sample (samples,): each view in units of what it leaves, a time of `SAMPLE` as one sample."""
    frame = likelihood.robot.machine.frame
    return likelihood.weights * np.float32(np.sqrt(max(CORRELATION / frame, 1.0) / max(SAMPLE / frame, 1.0)))


class Eliminated:
    """A linear model with its nuisance parameters eliminated.

    Args:
        likelihood: weights of the samples.
        offset: (samples,) residual at zero coordinates, r0.
        jacobian: (nuisance, samples) J.
        prior_std: (nuisance,) of x.
    """

    def __init__(self, likelihood: Likelihood, offset: np.ndarray, jacobian: np.ndarray, prior_std: np.ndarray) -> None:
        self.weights = weights_of(likelihood)
        self.jacobian = (jacobian * self.weights).astype(np.float32)
        self.inverse = np.linalg.inv(normal_matrix(self.jacobian, prior_std**-2.0))
        self.offset = (offset * self.weights).astype(np.float32)
        self.samples = likelihood.samples / max(SAMPLE / likelihood.robot.machine.frame, 1.0)
        self.least = float(np.sum(self.weights.astype(float) ** 2)) / self.samples
        self.pull = (self.jacobian @ self.offset).astype(float)
        self.left = float(self.offset.astype(float) @ self.offset - self.pull @ self.inverse @ self.pull)

    def columns(self, directions: np.ndarray) -> Columns:
        """The directions (n, samples) of a law beside the nuisance parameters."""
        weighted = (directions * self.weights).astype(np.float32)
        cross = (self.jacobian @ weighted.T).astype(float)
        gram = (weighted @ weighted.T).astype(float) - cross.T @ self.inverse @ cross
        return Columns(weighted, cross, gram, self.slope(weighted, cross, self.offset, self.pull))

    def slope(self, weighted: np.ndarray, cross: np.ndarray, row: np.ndarray, pull: np.ndarray) -> np.ndarray:
        """Products (n,) or (n, rows) of weighted directions with rows, nuisance parameters eliminated."""
        return (weighted @ row).astype(float) - cross.T @ (self.inverse @ pull)

    def products(self, rows: np.ndarray) -> np.ndarray:
        """Products (nuisance, n) of J with weighted rows (n, samples)."""
        return (self.jacobian @ rows.T).astype(float)

    def squares(self, rows: np.ndarray) -> np.ndarray:
        """Sum of squares (n,) of weighted rows (n, samples), nuisance parameters eliminated."""
        pull = self.products(rows)
        return np.einsum("ij,ij->i", rows, rows, dtype=float) - np.einsum("in,in->n", pull, self.inverse @ pull)

    def taken_up(self, columns: Columns, prior: np.ndarray, variance: float, rows: np.ndarray) -> np.ndarray:
        """Sum of squares (n,) that a law with prior standard deviations (directions,) takes up of weighted rows."""
        slope = self.slope(columns.weighted, columns.cross, rows.T, self.products(rows))
        return np.einsum("in,in->n", slope, np.linalg.solve(columns.gram + variance * np.diag(prior**-2.0), slope))

    def log_evidence(self, variance: Any, penalised: Any, information: float) -> Any:
        """Log evidence from the variance of a sample, squares over it with the use of the priors, and information."""
        return -0.5 * (self.samples * np.log(variance) + penalised + information)

    def nuisance(self, columns: Columns, modes: np.ndarray) -> np.ndarray:
        """Coordinates x (nuisance,) beside coordinates (n,) of the law."""
        return -self.inverse @ (self.pull + columns.cross @ modes)


@dataclass(frozen=True, eq=False)
class Columns:
    """Weighted directions (n, samples) of a law, their products with J, their Gram matrix, and their slopes (n,)."""

    weighted: np.ndarray
    cross: np.ndarray
    gram: np.ndarray
    slope: np.ndarray

    def part(self, rows: np.ndarray) -> Columns:
        """Some of the directions."""
        return Columns(self.weighted[rows], self.cross[:, rows], self.gram[np.ix_(rows, rows)], self.slope[rows])


@dataclass(frozen=True, eq=False)
class Weighed:
    """A fitted law.

    Attributes:
        log_evidence: of the logs.
        scales: (channels,) prior standard deviations, in units of the plausible size.
        modes: (n,) coordinates of the directions.
        covariance: (n, n) theirs.
        variance: of a sample.
        left: weighted sum of squares that is left, the use of the nuisance's priors included.
    """

    log_evidence: float
    scales: np.ndarray
    modes: np.ndarray
    covariance: np.ndarray
    variance: float
    left: float


def information(gram: np.ndarray, prior: np.ndarray, variance: float) -> float:
    """Log of the prior's volume over the posterior's, twice: Gram matrix (n, n) and prior standard deviations (n,)."""
    return float(np.linalg.slogdet(np.eye(len(prior)) + gram * np.outer(prior, prior) / variance)[1])


def weigh(model: Eliminated, columns: Columns, channel: np.ndarray, scales: np.ndarray) -> Weighed:
    """A law with given prior scales; channel (n,): of each direction."""
    prior = scales[channel]
    on = np.flatnonzero(prior > 0.0)
    gram, slope, prior = columns.gram[np.ix_(on, on)], columns.slope[on], prior[on]
    variance, best = max(model.left / model.samples, model.least), None
    for _ in range(ROUNDS):
        inverse = np.linalg.inv(gram / variance + np.diag(prior**-2.0))
        modes = -inverse @ slope / variance
        left = model.left + 2.0 * slope @ modes + modes @ gram @ modes
        penalised = left / variance + np.sum((modes / prior) ** 2)
        value = model.log_evidence(variance, penalised, information(gram, prior, variance))
        full, covariance = np.zeros(len(channel)), np.zeros((len(channel),) * 2)
        full[on], covariance[np.ix_(on, on)] = modes, inverse
        best = Weighed(float(value), scales, full, covariance, variance, float(left))
        variance = max(float(left) / model.samples, model.least)
    assert best is not None
    return best


def fitted(model: Eliminated, columns: Columns, channel: np.ndarray) -> Weighed:
    """A law with the prior scales of the largest evidence, found channel by channel."""
    scales = np.ones(int(channel.max()) + 1)
    best = weigh(model, columns, channel, scales)
    for _ in range(PASSES):
        for c in range(len(scales)):
            for s in SCALES:
                trial = best.scales.copy()
                trial[c] = s
                found = weigh(model, columns, channel, trial)
                best = max(best, found, key=lambda w: w.log_evidence)
    return best


def without(model: Eliminated) -> Weighed:
    """The logs without a law."""
    nothing = Columns(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0))
    return weigh(model, nothing, np.zeros(0, dtype=int), np.zeros(0))
