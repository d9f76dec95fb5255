"""Evidence of inputs whose amplitudes are free in each cell of time (`free_input` has the formula).

x and c are eliminated in closed form. s and v are those of the largest evidence (MacKay, Neural Computation 4(3),
1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from exodrake.diagnosis.trial import Trial

CELL = 2  # samples with one amplitude, 0.2 s: shorter than a motion takes to turn round; assumed
ROUNDS = 15  # of the fixed point


@dataclass(frozen=True, eq=False)
class Products:
    """Products of the responses for each kind of column in each cell of time.

    Attributes:
        gram: (kinds, cells, channels, channels) with each other.
        cross: (kinds, cells, channels, nominal) with the nominal Jacobian.
        slope: (kinds, cells, channels) with the offset.
    """

    gram: np.ndarray
    cross: np.ndarray
    slope: np.ndarray


@dataclass(frozen=True, eq=False)
class Solution:
    """Nominal parameters and amplitudes eliminated at given variances and scales.

    Attributes:
        log_evidence: of the logs.
        squares: (kinds,) sum of squares that is left.
        used: (kinds,) number of parameters that they determine.
        amplitudes: (cells, channels) mean.
        covariance: (cells, channels, channels) of the amplitudes of a cell.
    """

    log_evidence: float
    squares: np.ndarray
    used: np.ndarray
    amplitudes: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class Fit:
    """The variances and scales of the largest evidence.

    Attributes:
        log_evidence: of the logs.
        variance: (kinds,) of the residual v [noise variance].
        scale: (channels,) of the amplitudes s.
        count: (channels,) number of amplitudes that the logs determine.
    """

    log_evidence: float
    variance: np.ndarray
    scale: np.ndarray
    count: np.ndarray


class Cells:
    """The logs of the last view in cells of time, with the nominal parameters eliminated.

    Args:
        offset: (samples,) residual with nominal parameters at 0, as the Jacobian expects it.
        jacobian: (nominal, samples) its derivatives. prior_std: (nominal,).
        trials: logs. kinds: of their columns; each has a residual variance of its own. frames: that make a sample.
    """

    def __init__(
        self, offset: np.ndarray, jacobian: np.ndarray, prior_std: np.ndarray, trials: Sequence[Trial],
        kinds: Sequence[str], frames: int,
    ) -> None:  # fmt: skip
        self.trials, self.precision, self.frames = trials, prior_std**-2.0, frames
        names = list(dict.fromkeys(kinds))
        kind = np.tile([names.index(k) for k in kinds], CELL)
        self.kinds = [np.flatnonzero(kind == k) for k in range(len(names))]
        self.offset = self.cut(offset[None])[:, :, 0]
        whole = self.cut(jacobian)
        self.jacobian = [whole[:, at] for at in self.kinds]
        self.offsets = [self.offset[:, at] for at in self.kinds]
        self.count = np.array([y.size for y in self.offsets])
        flat = [j.reshape(-1, len(prior_std)) for j in self.jacobian]
        self.normal = np.array([j.T @ j for j in flat])
        self.pull = np.array([j.T @ y.ravel() for j, y in zip(flat, self.offsets, strict=True)])
        self.squares = np.array([float(np.sum(y**2)) for y in self.offsets])
        self.variance = np.maximum(self.squares / self.count, 1.0)
        none = self.products(np.zeros((*self.offset.shape, 0)))
        self.alone = self.fitted(none, np.zeros(0), np.zeros(0))
        self.variance = self.alone.variance

    def cut(self, rows: np.ndarray) -> np.ndarray:
        """Rows (n, samples) as means over `frames`, in units of their noise (cells, samples of a cell, n)."""
        parts, ends = [], np.cumsum([t.measured.size for t in self.trials])[:-1]
        for part, trial in zip(np.split(rows, ends, axis=1), self.trials, strict=True):
            columns = trial.measured.shape[1]
            cells = len(trial.measured) // (CELL * self.frames)
            used = part.reshape(len(rows), -1, columns)[:, : cells * CELL * self.frames]
            means = used.reshape(len(rows), cells * CELL, self.frames, columns).sum(axis=2) / np.sqrt(self.frames)
            parts.append(means.reshape(len(rows), cells, CELL * columns))
        return np.concatenate(parts, axis=1, dtype=float).transpose(1, 2, 0)

    def products(self, responses: np.ndarray) -> Products:
        """Products of responses (cells, samples, channels) with each other, the Jacobian and the offset."""
        own = [np.ascontiguousarray(responses[:, at].transpose(0, 2, 1)) for at in self.kinds]
        return Products(
            np.array([f @ f.transpose(0, 2, 1) for f in own]),
            np.array([f @ j for f, j in zip(own, self.jacobian, strict=True)]),
            np.array([(f @ y[:, :, None])[:, :, 0] for f, y in zip(own, self.offsets, strict=True)]),
        )

    def first_scale(self, found: Products) -> np.ndarray:
        """Scales (channels,) as each channel alone would need them."""
        gram, slope = (np.tensordot(1.0 / self.variance, p, 1) for p in (found.gram, found.slope))
        own = np.maximum(np.einsum("taa->ta", gram), 1e-9)
        return np.sqrt(np.sum(slope**2 / own, axis=0) / np.sum(own, axis=0))

    def fitted(self, found: Products, scale: np.ndarray, largest: np.ndarray) -> Fit:
        """The largest evidence, by a fixed point from scales (channels,) on; none is above `largest` (channels,)."""
        variance, best = np.maximum(0.5 * self.variance, 1.0), Fit(-np.inf, self.variance, scale, scale)
        for _ in range(ROUNDS):
            scale = np.clip(scale, 1e-6, np.maximum(largest, 1e-6))
            at = self.solved(found, variance, scale)
            count = np.maximum(len(self.offset) - np.einsum("taa->a", at.covariance) / scale**2, 1e-3)
            if at.log_evidence > best.log_evidence:
                best = Fit(at.log_evidence, variance, scale, count)
            variance = np.maximum(at.squares / np.maximum(self.count - at.used, 0.05 * self.count), 1.0)
            scale = np.sqrt(np.sum(at.amplitudes**2, axis=0) / count)
        return best

    def solved(self, found: Products, variance: np.ndarray, scale: np.ndarray) -> Solution:
        """The solution at given variances (kinds,) and scales (channels,)."""
        weight, n = 1.0 / variance, len(self.precision)
        normal, pull = np.tensordot(weight, self.normal, 1) + np.diag(self.precision), weight @ self.pull
        gram = np.tensordot(weight, found.gram, 1) + np.diag(scale**-2.0)
        cross, slope = np.tensordot(weight, found.cross, 1), np.tensordot(weight, found.slope, 1)
        inverse = np.linalg.inv(gram)
        solved = inverse @ cross
        flat = solved.reshape(-1, n)
        schur = normal - cross.reshape(-1, n).T @ flat
        covariance = np.linalg.inv(0.5 * (schur + schur.T))
        x = -covariance @ (pull - flat.T @ slope.ravel())
        c = -(inverse @ slope[:, :, None])[:, :, 0] - solved @ x
        mixed = solved @ covariance
        own = inverse + mixed @ solved.transpose(0, 2, 1)
        squares = self.squares + 2.0 * self.pull @ x + np.einsum("i,kij,j->k", x, self.normal, x)
        squares += np.einsum("ta,ktab,tb->k", c, found.gram, c) + 2.0 * np.einsum("kta,ta->k", found.slope, c)
        squares += 2.0 * np.einsum("ta,kta->k", c, found.cross @ x)
        used = np.einsum("ij,kij->k", covariance, self.normal) + np.einsum("tab,ktab->k", own, found.gram)
        used = weight * (used - 2.0 * np.einsum("tap,ktap->k", mixed, found.cross))
        volume = np.linalg.slogdet(schur)[1] + float(np.sum(np.linalg.slogdet(gram)[1]))
        volume += 2.0 * len(self.offset) * float(np.sum(np.log(scale))) - float(np.sum(np.log(self.precision)))
        priors = float(np.sum(self.precision * x**2) + np.sum((c / scale) ** 2))
        value = -0.5 * (float(self.count @ np.log(variance) + weight @ squares) + priors + volume)
        return Solution(value, squares, used, c, own)
