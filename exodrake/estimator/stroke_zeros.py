"""Zeros of the strokes in a new session: found, tested and corrected without measured angles.

Re-donning shifts the zero of each wire's stroke, which the estimator would read as motion (`physics.md` 4.G: 0.5 to
3 mm, some 0.1 rad per mm). In training, strokes follow from tensions but for the variation between sweeps. A second
Gaussian process with the covariance of `kernels` predicts them, and generalised least squares finds the constants z
that a session adds. With residuals r (rows, wires) and their covariance C (rows, rows) up to the scale of each wire,

    z = r' C^-1 1 / kappa      Cov(z) = Sigma / kappa      kappa = 1' C^-1 1

For a training sweep B given the others, C^-1 = [K^-1]_BB and C^-1 r = [K^-1 y]_B (`gp.leave_one_sweep_out`), so
sqrt(kappa) z of the training sweeps in turn estimates Sigma. z counts as moved if z' (Cov(z) + TOLERANCE^2 I)^-1 z
exceeds the quantile of Hotelling's T^2. Corrected strokes are s - z: since inputs enter linearly, a shift of the
estimator's center.

A changed rest posture of the wearer looks like a shift and is corrected as one. A session whose residuals a constant
does not explain (contact, another wearer) is reported as unlike the training and left alone.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import f as fisher

from exodrake.core.confidence import NORMAL_95
from exodrake.core.threads import thread_limit
from exodrake.estimator.dataset import Sweeps
from exodrake.estimator.prior import JITTER, Prior, learn, scaled

POINTS = 250  # training rows: strokes follow tensions smoothly
ROWS = 200  # rows of a session, equispaced
TOLERANCE = 7e-5  # m; a shift as small costs up to 0.01 rad (MF 0.14 rad/mm), a third of the paper's 0.03 rad
FALSE = 0.01  # probability that zeros which have not moved count as moved
UNLIKE = 4.0  # standard deviations by which the reduced chi-square of a session exceeds that of training sweeps


@dataclass(frozen=True)
class Zeros:
    """Shift of the stroke zeros of a session against training.

    Attributes:
        wires: Names of the wires.
        shift: (wires,) [m].
        covariance: (wires, wires) [m2].
        moved: Whether the shift is more than variation between sweeps, and a constant explains the residuals.
        unlike: Whether a constant does not explain the residuals: contact, another wearer or robot.
    """

    wires: tuple[str, ...]
    shift: np.ndarray
    covariance: np.ndarray
    moved: bool
    unlike: bool

    @property
    def half_widths(self) -> np.ndarray:
        """95 % half widths (wires,) [m]."""
        return NORMAL_95 * np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, eq=False)
class StrokeModel:
    """Strokes that training sweeps show at their tensions.

    Attributes:
        rows: Training rows: tensions [N] as inputs, strokes [m] as outputs (`angle`).
        theta: Logarithms of the hyperparameters of the covariance.
    """

    rows: Sweeps
    theta: np.ndarray

    @cached_property
    def prior(self) -> Prior:
        """Covariance and scaling."""
        start = scaled(self.rows)
        return replace(start, kernel=start.kernel.clone_with_theta(self.theta))

    @cached_property
    def inverse(self) -> np.ndarray:
        """K^-1 of the training rows (n, n) [-]."""
        covariance = self.prior.kernel(self.prior.rows(self.rows)) + JITTER * np.eye(len(self.rows))
        return cho_solve(cho_factor(covariance), np.eye(len(covariance)))

    @cached_property
    def held_out(self) -> tuple[np.ndarray, np.ndarray]:
        """Sigma (wires, wires) and the reduced chi-square (sweeps,) of each training sweep given the others [-]."""
        weighted, labels = self.inverse @ self.prior.targets(self.rows), np.unique(self.rows.sweep)
        shifts, left = [], []
        for label in labels:
            own = self.rows.sweep == label
            precision, pulled = self.inverse[np.ix_(own, own)], weighted[own]
            shift, kappa, chi2 = _constant(precision, np.linalg.solve(precision, pulled))
            shifts.append(np.sqrt(kappa) * shift)
            left.append(chi2)
        return np.stack(shifts).T @ np.stack(shifts) / len(labels), np.array(left)

    def zeros(self, session: Sweeps) -> Zeros:
        """Estimate and test the zeros of a session from its tensions and strokes."""
        prior, sigma, left = self.prior, *self.held_out
        chosen = stroke_rows(session).equispaced(ROWS)
        chosen = replace(chosen, sweep=chosen.sweep - chosen.sweep.min() + self.rows.sweep.max() + 1)
        known, new = prior.rows(self.rows), prior.rows(chosen)
        with thread_limit():
            cross = prior.kernel(new, known)
            residual = prior.targets(chosen) - cross @ (self.inverse @ prior.targets(self.rows))
            covariance = prior.kernel(new) - cross @ self.inverse @ cross.T + JITTER * np.eye(len(new))
            shift, kappa, chi2 = _constant(np.linalg.inv(covariance), residual)
        spread = np.outer(prior.gain, prior.gain) * sigma / kappa
        shift = prior.gain * shift
        distance = shift @ np.linalg.solve(spread + TOLERANCE**2 * np.eye(len(shift)), shift)
        unlike = bool(chi2 > left.mean() + UNLIKE * left.std() / np.sqrt(chosen.count))
        moved = bool(distance > hotelling(len(shift), self.rows.count))
        return Zeros(self.rows.wires, shift, spread, moved and not unlike, unlike)


def learn_strokes(sweeps: Sweeps, points: int = POINTS) -> StrokeModel:
    """Learn the strokes of training sweeps from their tensions, from at most `points` rows."""
    rows = stroke_rows(sweeps).equispaced(points)
    return StrokeModel(rows, learn(rows, points).kernel.theta)


def stroke_rows(sweeps: Sweeps) -> Sweeps:
    """Rows with tensions [N] as inputs and strokes [m] as outputs."""
    return replace(sweeps, inputs=sweeps.tension, angle=sweeps.stroke)


def hotelling(wires: int, sweeps: int) -> float:
    """Quantile of Hotelling's T^2 for the shift of some wires, its covariance about 0 estimated from some sweeps."""
    free = max(sweeps - wires + 1, 1)
    return wires * sweeps / free * float(fisher.ppf(1 - FALSE, wires, free))


def _constant(precision: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Constant (wires,), kappa and reduced chi-square of the rest, from precision (n, n) and residuals (n, wires)."""
    pulled = precision @ residual
    kappa = float(precision.sum())
    shift = pulled.sum(axis=0) / kappa
    left = residual - shift
    return shift, kappa, float(np.einsum("iw,ij,jw->", left, precision, left)) / left.size
