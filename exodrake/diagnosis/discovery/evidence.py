"""Marginal likelihood of a free law: linear weights with a normal prior beside nuisance parameters.

    r = r0 + J x + F c          x ~ N(0, P^-1)          c_i ~ N(0, s_channel^2)          residual ~ N(0, v) a sample

x is eliminated (Schur complement). The scale s of each channel and the variance v are those of the largest evidence
(MacKay, Neural Computation 4(3), 1992); a channel that the logs do not need gets s = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.diagnosis.likelihood import CORRELATION, SAMPLE, Likelihood

SCALES = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)  # of a law in units of its plausible size
TIGHTER = float(np.sqrt(SAMPLE / CORRELATION))  # of tolerances, so that they count as where `CORRELATION` is a sample
PASSES, ROUNDS = 2, 4  # over the channels; of the residual's variance


def weights_of(likelihood: Likelihood) -> np.ndarray:
    """Weight of each sample (samples,): each view in units of what it leaves, a time of `SAMPLE` as one sample."""
    frame = likelihood.robot.machine.frame
    return likelihood.weights * np.float32(np.sqrt(max(CORRELATION / frame, 1.0) / max(SAMPLE / frame, 1.0)))


class Eliminated:
    """A linear model with its nuisance parameters eliminated, in the basis in which J J' and P are diagonal.

    Args:
        likelihood: weights of the samples.
        offset: (samples,) residual at zero coordinates, r0.
        jacobian: (nuisance, samples) J.
        prior_std: (nuisance,) of x.
    """

    def __init__(self, likelihood: Likelihood, offset: np.ndarray, jacobian: np.ndarray, prior_std: np.ndarray) -> None:
        self.weights, prior_std = weights_of(likelihood), prior_std * TIGHTER
        self.jacobian = np.asarray(jacobian, float) * self.weights * prior_std[:, None]
        roots, self.axes = np.linalg.eigh(self.jacobian @ self.jacobian.T)
        self.roots, self.prior_std = np.maximum(roots, 0.0), prior_std
        self.offset = np.asarray(offset, float) * self.weights
        self.samples = likelihood.samples / max(SAMPLE / likelihood.robot.machine.frame, 1.0)
        self.least = float(np.sum(self.weights.astype(float) ** 2)) / self.samples
        self.pull = self.products(self.offset[None])[:, 0]
        self.squares = float(self.offset @ self.offset)

    def products(self, rows: np.ndarray) -> np.ndarray:
        """Products (nuisance, n) of J with weighted rows (n, samples)."""
        return self.axes.T @ (self.jacobian @ rows.T)

    def columns(self, directions: np.ndarray) -> Columns:
        """The directions (n, samples) of a law beside the nuisance parameters, kept in single precision."""
        weighted = directions * self.weights
        found = self.products(weighted), weighted @ weighted.T, weighted @ self.offset
        return Columns(weighted.astype(np.float32), *found)

    def eliminated(self, variance: float) -> np.ndarray:
        """Weights (nuisance,) of products with J in products of rows over the variance, x eliminated."""
        return 1.0 / (variance * (self.roots + variance))

    def left(self, variance: float) -> float:
        """Sum of squares over the variance that is left without a law, the use of the nuisance's priors included."""
        return self.squares / variance - float(self.eliminated(variance) @ self.pull**2)

    def gram(self, columns: Columns, variance: float) -> np.ndarray:
        """Gram matrix (n, n) of directions over the variance, x eliminated."""
        return columns.gram / variance - (columns.cross.T * self.eliminated(variance)) @ columns.cross

    def slope(self, columns: Columns, variance: float) -> np.ndarray:
        """Products (n,) of directions with the offset over the variance, x eliminated."""
        return columns.slope / variance - columns.cross.T @ (self.eliminated(variance) * self.pull)

    def taken_up(self, columns: Columns, prior: np.ndarray, variance: float, rows: np.ndarray) -> np.ndarray:
        """Sum of squares (n,) that a law with prior standard deviations (directions,) takes up of weighted rows."""
        pull = self.eliminated(variance)[:, None] * self.products(rows)
        slope = columns.weighted @ rows.T / variance - columns.cross.T @ pull
        normal = self.gram(columns, variance) + np.diag(prior**-2.0)
        return variance * np.einsum("in,in->n", slope, np.linalg.solve(normal, slope))

    def log_evidence(self, variance: float, penalised: float, information: float) -> float:
        """Log evidence from the variance of a sample, squares over it with the use of the priors, and information."""
        nuisance = float(np.sum(np.log1p(self.roots / variance)))
        return -0.5 * (self.samples * float(np.log(variance)) + penalised + information + nuisance)

    def use(self, columns: Columns, modes: np.ndarray, variance: float) -> np.ndarray:
        """Coordinates (nuisance,) beside coordinates (n,) of the law, in prior standard deviations, on the axes."""
        return -(self.pull + columns.cross @ modes) / (self.roots + variance)

    def nuisance(self, columns: Columns, weighed: Weighed) -> np.ndarray:
        """Coordinates x (nuisance,) beside a fitted law."""
        return self.prior_std * (self.axes @ self.use(columns, weighed.modes, weighed.variance))


@dataclass(frozen=True, eq=False)
class Columns:
    """Weighted directions (n, samples) of a law, and their products with J, with each other and with the offset."""

    weighted: np.ndarray
    cross: np.ndarray
    gram: np.ndarray
    slope: np.ndarray


@dataclass(frozen=True, eq=False)
class Weighed:
    """A fitted law.

    Attributes:
        log_evidence: of the logs.
        scales: (channels,) prior standard deviations, in units of the plausible size.
        modes: (n,) coordinates of the directions.
        covariance: (n, n) theirs.
        variance: of a sample.
        left: squares that are left over the variance, with the use of all priors.
        penalised: the same and the law's information.
    """

    log_evidence: float
    scales: np.ndarray
    modes: np.ndarray
    covariance: np.ndarray
    variance: float
    left: float
    penalised: float


def information(gram: np.ndarray, prior: np.ndarray) -> float:
    """Log of the prior's volume over the posterior's, twice: Gram matrix (n, n) and prior standard deviations (n,)."""
    return float(np.linalg.slogdet(np.eye(len(prior)) + gram * np.outer(prior, prior))[1])


def weigh(model: Eliminated, columns: Columns, channel: np.ndarray, scales: np.ndarray) -> Weighed:
    """A law with given prior scales; channel (n,): of each direction."""
    prior = scales[channel]
    on = np.flatnonzero(prior > 0.0)
    own = Columns(columns.weighted, columns.cross[:, on], columns.gram[np.ix_(on, on)], columns.slope[on])
    variance, best, prior = max(model.left(1.0) / model.samples, model.least), None, prior[on]
    for _ in range(ROUNDS):
        gram, slope, left = model.gram(own, variance), model.slope(own, variance), model.left(variance)
        inverse = np.linalg.inv(gram + np.diag(prior**-2.0))
        modes = -inverse @ slope
        left += float(2.0 * slope @ modes + modes @ gram @ modes)
        used, within = float(np.sum((modes / prior) ** 2)), information(gram, prior)
        value = model.log_evidence(variance, left + used, within)
        full, covariance = np.zeros(len(channel)), np.zeros((len(channel),) * 2)
        full[on], covariance[np.ix_(on, on)] = modes, inverse
        best = Weighed(value, scales, full, covariance, variance, left + used, left + used + within)
        residual = variance * (left - float(np.sum(model.use(own, modes, variance) ** 2)))
        variance = max(residual / model.samples, model.least)
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
    nothing = Columns(np.zeros((0, 0)), np.zeros((len(model.pull), 0)), np.zeros((0, 0)), np.zeros(0))
    return weigh(model, nothing, np.zeros(0, dtype=int), np.zeros(0))
