"""What a motion tells of rivals, each of them refitted (T-optimality; Atkinson & Fedorov 1975).

If i is true and j is fitted to the new log and to what is known already, j leaves

    T_ij = min_z  (d - J z)' W (d - J z) + z'z  =  d'Wd - d'WJ (1 + J'WJ)^-1 J'Wd

d: whitened difference of their logs. J: derivatives of j's log by its parameters in units of what the present logs
leave uncertain (`Contest.spreads`). W: one over the variance of a sample,

    1 / w = n (1 + c_i^2 + c_j^2)       c: error of an effect's law in another simulator of the same law

n: frames that count as one. A simpler law of the effects of i counts with the error that a diagnosis grants a law.
d'Wd, J'Wd and J'WJ add over motions, which makes the search for a sequence cheap.

A diagnosis rejects j where i takes up more than chance and a share q of what j leaves above noise, so T must exceed

    T*_ij = max(z^2, E_i q / (1 - q))       E_i: what i itself leaves above noise, in the present logs and the new one

or z^2 alone for an effect that means the same in every law, since of it no error of a law is granted.
The probability of that is Phi((sqrt T - sqrt T*) / s): s^2 is 1 for noise, and more as E_i differs in a new motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from exodrake.diagnosis.calibration import calibration_of
from exodrake.diagnosis.comparison import contributions, richer_law
from exodrake.diagnosis.likelihood import CORRELATION, Likelihood
from exodrake.diagnosis.parameter import STEP, apply
from exodrake.diagnosis.problem import Trial
from exodrake.diagnosis.refine import Explanation
from exodrake.experiment.contest import Contest

CHANCE = 4.0  # z, of the best of a hundred effects and channels at 0.3 % (normal law)
UNSURE = 0.25  # relative standard deviation of sqrt(E) in a new motion: assumed
DIRECTIONS, WEAK = 10, 0.02  # kept in a search at most, and the least sum of squares of one on a pilot: assumed


@dataclass(frozen=True, eq=False)
class Pair:
    """d'Wd, J'Wd (parameters,) and J'WJ (parameters, parameters) of a rival against a true explanation."""

    square: float
    slope: np.ndarray
    normal: np.ndarray

    def __add__(self, other: Pair) -> Pair:
        return Pair(self.square + other.square, self.slope + other.slope, self.normal + other.normal)

    @property
    def refit(self) -> np.ndarray:
        """Change (parameters,) of the refitted parameters, in units of what the present logs leave uncertain."""
        return np.linalg.solve(np.eye(len(self.slope)) + self.normal, self.slope)

    @property
    def left(self) -> float:
        """T: what the rival leaves once it is refitted."""
        return max(self.square - float(self.slope @ self.refit), 0.0)


def pair_of(difference: np.ndarray, columns: np.ndarray, weights: np.ndarray) -> Pair:
    """The information of samples: difference (samples,), derivatives (parameters, samples), weights (samples,)."""
    weighted = columns * weights
    return Pair(float(difference @ (weights * difference)), weighted @ difference, weighted @ columns.T)


@dataclass(frozen=True, eq=False)
class Information:
    """What motions tell.

    Attributes:
        pairs: (true, rival) -> information.
        excess: (explanations,) what each leaves above noise in the present logs and these.
        present: (explanations,) of that, the part in the present logs.
        share: q, that a true explanation takes up of what a wrong one leaves.
        granted: (explanations,) whether the law of one of its effects may be wrong; else noise alone is granted it.
    """

    pairs: dict[tuple[int, int], Pair]
    excess: np.ndarray
    present: np.ndarray
    share: float
    granted: np.ndarray

    def __add__(self, other: Information) -> Information:
        pairs = {key: pair + other.pairs[key] for key, pair in self.pairs.items()}
        return replace(self, pairs=pairs, excess=self.excess + other.excess - self.present)

    @property
    def left(self) -> dict[tuple[int, int], float]:
        """(true, rival) -> T."""
        return {key: pair.left for key, pair in self.pairs.items()}

    def beyond(self, true: int, rival: int) -> float:
        """By how many standard deviations the root of T exceeds that of T*."""
        excess = float(self.excess[true]) if self.granted[rival] else 0.0
        required = np.sqrt(excess * self.share / (1.0 - self.share))
        distance = np.sqrt(self.pairs[true, rival].left) - max(CHANCE, required)
        return float(distance / np.hypot(1.0, UNSURE * required))

    @property
    def criterion(self) -> float:
        """Logarithm of the product of all probabilities: what a search maximises."""
        from scipy.stats import norm

        return float(sum(norm.logcdf(self.beyond(*key)) for key in self.pairs))

    @property
    def closest(self) -> tuple[int, int]:
        """The (true, rival) that is distinguished worst."""
        return min(self.pairs, key=lambda key: self.beyond(*key))

    def power(self, true: int, rival: int) -> float:
        """Probability that a rival is rejected where another explanation is true."""
        from scipy.stats import norm

        return float(norm.cdf(self.beyond(true, rival)))

    @property
    def probability(self) -> float:
        """Probability that all but the true explanation are rejected, each as likely to be true."""
        return float(np.mean([self.resolved(i) for i in sorted({true for true, _ in self.pairs})]))

    def resolved(self, true: int) -> float:
        """Probability that all rivals of a true explanation are rejected: that of the closest one."""
        return min(self.power(*key) for key in self.pairs if key[0] == true)


def trial_of(contest: Contest, reference: np.ndarray) -> Trial:
    """A log (frames, columns) that the first explanation would leave on a reference (frames, references) [SI]."""
    problem = contest.problem
    empty = Trial("experiment", "fit", reference, np.zeros((len(reference), len(problem.columns))))
    return replace(empty, measured=problem.predict(contest.robots[:1], empty)[0])


def likelihood_on(contest: Contest, reference: np.ndarray) -> Likelihood:
    """The likelihood of that log, whitened as the logs of the case are."""
    (view,) = contest.likelihood.views
    problem = replace(contest.problem, fit=(trial_of(contest, reference),))
    return Likelihood((replace(view, problem=problem, noise=()),))


def information(contest: Contest, reference: np.ndarray) -> Information | None:
    """What a reference (frames, references) [SI] tells; None if a robot does not come to its end."""
    likelihood = likelihood_on(contest, reference)
    rows = likelihood.residual(contest.robots)
    errors = [contributed(likelihood, e, row) for e, row in zip(contest.explanations, rows, strict=True)]
    columns = [
        derivatives(likelihood, e, spread, row)
        for e, row, spread in zip(contest.explanations, rows, contest.spreads, strict=True)
    ]
    if not all(np.isfinite(part).all() for part in (rows, *errors, *columns)):
        return None
    limits, es = calibration_of(contest.problem.robot.machine), contest.explanations
    frames, pairs = max(CORRELATION / contest.problem.robot.machine.frame, 1.0), {}
    for i, j in permutations(range(len(rows)), 2):
        rho = limits.law_error if richer_law(likelihood, es[i], es[j]) else limits.same_meaning
        weights = 1.0 / (frames * (1.0 + limits.same_meaning**2 * errors[i] + rho**2 * errors[j]))
        pairs[i, j] = pair_of(rows[j] - rows[i], -columns[j], weights)
    left = np.array([max(float(contest.likelihood.chi2(e.residual)[0]) - 1.0, 0.0) for e in es]) / frames
    use = np.array([float(np.sum(e.use[: e.nominal] ** 2)) for e in es])
    present = left * contest.likelihood.samples + use
    machine = contest.problem.robot.machine
    granted = np.array([any(not machine.effect(i).same_meaning for i in e.effects) for e in es])
    return Information(pairs, present + left * rows.shape[1], present, limits.taken, granted)


def derivatives(likelihood: Likelihood, e: Explanation, spread: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Derivatives (directions, samples) of the residual (samples,) of an explanation along `spread`'s columns."""
    scale = np.array([p.scale for p in e.parameters])[:, None]
    steps = STEP / np.maximum(np.abs(spread / scale).max(axis=0), 1e-12)
    low, high = e.bounds
    moved = e.x + (spread * steps).T
    outside = ((moved < low) | (moved > high)).any(axis=1)
    steps = np.where(outside, -steps, steps)
    rows = [apply(e.values, e.parameters, np.clip(e.x + step * v, low, high)) for step, v in zip(steps, spread.T)]
    return (likelihood.residual(np.array(rows)) - residual) / steps[:, None]


def contributed(likelihood: Likelihood, e: Explanation, residual: np.ndarray) -> np.ndarray:
    """Sum of squares (samples,) of what the effects of an explanation contribute channel by channel [noise_std^2]."""
    found = contributions(likelihood.robot.machine, e, likelihood.residual, residual)
    return np.sum([np.zeros(len(residual)), *(np.sum(rows**2, axis=0) for rows in found.values())], axis=0)


def reduced(contest: Contest, pilot: Information) -> Contest:
    """The contest with the directions alone in which a refit changes a pilot motion, for a quick search."""
    spreads = []
    for j, spread in enumerate(contest.spreads):
        normal = next(pair.normal for (_, rival), pair in pilot.pairs.items() if rival == j)
        size, axes = np.linalg.eigh(normal)
        keep = np.argsort(size)[::-1][:DIRECTIONS]
        spreads.append(spread @ axes[:, [k for k in keep if size[k] > WEAK] or keep[:1]])
    return replace(contest, spreads=tuple(spreads))
