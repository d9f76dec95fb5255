"""What a motion tells of rivals, each of them refitted (T-optimality; Atkinson & Fedorov 1975).

If i is true and j is fitted to the new log and to what is known already, j leaves

    T_ij = min_z  (d - J z)' W (d - J z) + z'z  =  d'Wd - d'WJ (1 + J'WJ)^-1 J'Wd

d: whitened difference of their logs. J: derivatives of j's log by its parameters in units of what the present logs
leave uncertain (`Contest.spreads`). W: one over the variance of a sample,

    1 / w = n                             n: frames that count as one

d'Wd, J'Wd and J'WJ add over motions, which makes the search for a sequence cheap. What the law of i is wrong by, and so
what i itself leaves, grows with what its effects contribute: E_i = a_i^2 C_i, with a_i as in the present logs.

A diagnosis (`diagnosis.levels`) rejects j where it leaves more than the error rho_j that its law is granted or, unless
i is a richer law of the same effects, where i takes up a share q of what j leaves above noise. So T must exceed

    T*_ij = max(z^2, min(rho_j^2 C_j - E_i, E_i q / (1 - q)))

z: chance. T is that of a linear refit, which a snap or a stop makes worthless: there, small changes of parameters move
a jump in time. So T must exceed q / (1 - q) times B_i + B_j, too, what a change by as much as the present logs leave
uncertain misses the linearisation by. The probability of that is Phi((sqrt T - sqrt T*) / s): s^2 is 1 for noise, and
more as E_i and C_j differ in a new motion. A richer law j of a true i leaves as little as i does and is dropped as
needless where it takes up nothing: as probable as the reverse.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.parameter import STEP, apply
from exodrake.diagnosis.problem import Trial
from exodrake.diagnosis.refine import Explanation
from exodrake.experiment.contest import Contest, Laws, contributed, effective

CHANCE = 4.0  # z, of the best of a hundred effects and channels at 0.3 % (normal law)
UNSURE = 0.25  # relative standard deviation of sqrt(E) in a new motion: assumed
DRAWS = 2  # of changes of the parameters: assumed
DIRECTIONS, WEAK = 16, 0.02  # kept in a search at most, and the least sum of squares of one on a pilot: assumed


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
        contributed: (explanations,) C, what the effects of each contribute in the present logs and these.
        bent: (explanations,) B, what plausible changes of the parameters of each miss the linearisation by in these.
        laws: what the present logs tell of the laws.
    """

    pairs: dict[tuple[int, int], Pair]
    contributed: np.ndarray
    bent: np.ndarray
    laws: Laws

    def __add__(self, other: Information) -> Information:
        pairs = {key: pair + other.pairs[key] for key, pair in self.pairs.items()}
        contributed = self.contributed + other.contributed - self.laws.contributed
        return replace(self, pairs=pairs, contributed=contributed, bent=self.bent + other.bent)

    @property
    def left(self) -> dict[tuple[int, int], float]:
        """(true, rival) -> T."""
        return {key: pair.left for key, pair in self.pairs.items()}

    def required(self, true: int, rival: int) -> float:
        """T* without the part of chance; not below 0."""
        laws = self.laws
        excess = float(laws.error[true] ** 2 * self.contributed[true])
        granted = float(laws.granted[rival] ** 2 * self.contributed[rival])
        beaten = np.inf if laws.richer[true, rival] else excess * laws.share / (1.0 - laws.share)
        bent = float(self.bent[true] + self.bent[rival]) * laws.share / (1.0 - laws.share)
        return max(min(beaten, granted - excess), bent)

    def beyond(self, true: int, rival: int) -> float:
        """By how many standard deviations the root of T exceeds that of T*."""
        if self.laws.richer[rival, true]:
            true, rival = rival, true
        required = np.sqrt(self.required(true, rival))
        distance = np.sqrt(self.pairs[true, rival].left) - max(CHANCE, required)
        return float(distance / np.hypot(1.0, UNSURE * required))

    @property
    def criterion(self) -> tuple[float, float]:
        """What a search maximises: logarithm of the product of all probabilities, then the least `beyond`."""
        from scipy.stats import norm

        beyond = [self.beyond(*key) for key in self.pairs]
        return float(np.sum(norm.logcdf(beyond))), min(beyond)

    @property
    def closest(self) -> tuple[int, int]:
        """The (true, rival) that is distinguished worst; of two laws of the same effects the richer one is true."""
        true, rival = min(self.pairs, key=lambda key: self.beyond(*key))
        return (rival, true) if self.laws.richer[rival, true] else (true, rival)

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
    errors = [
        sum(float(np.sum(part**2)) for part in contributed(likelihood, e, row).values())
        for e, row in zip(contest.explanations, rows, strict=True)
    ]
    columns = [
        derivatives(likelihood, e, spread, row)
        for e, row, spread in zip(contest.explanations, rows, contest.spreads, strict=True)
    ]
    each = zip(contest.explanations, contest.spreads, rows, columns, strict=True)
    bent = np.array([nonlinearity(likelihood, *one) for one in each])
    if not all(np.isfinite(part).all() for part in (rows, bent, *errors, *columns)):
        return None
    frames, pairs = effective(contest.likelihood), {}
    weights = np.full(rows.shape[1], 1.0 / frames)
    for i, j in permutations(range(len(rows)), 2):
        pairs[i, j] = pair_of(rows[j] - rows[i], -columns[j], weights)
    laws = contest.laws
    return Information(pairs, laws.contributed + laws.own * np.array(errors) / frames, bent / frames, laws)


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


def nonlinearity(
    likelihood: Likelihood, e: Explanation, spread: np.ndarray, residual: np.ndarray, columns: np.ndarray
) -> float:
    """Mean sum of squares that drawn changes of the parameters along `spread` miss the linearisation by."""
    draws = np.random.default_rng(0).standard_normal((DRAWS, spread.shape[1]))
    moved = np.clip(e.x + draws @ spread.T, *e.bounds)
    along = np.linalg.lstsq(spread, (moved - e.x).T, rcond=None)[0].T
    rows = np.array([apply(e.values, e.parameters, x) for x in moved])
    missed = likelihood.residual(rows) - residual - along @ columns
    return float(np.mean(np.sum(missed**2, axis=1)))


def reduced(contest: Contest, pilot: Information) -> Contest:
    """The contest with the directions alone in which a refit changes a pilot motion, for a quick search."""
    spreads = []
    for j, spread in enumerate(contest.spreads):
        normal = next(pair.normal for (_, rival), pair in pilot.pairs.items() if rival == j)
        size, axes = np.linalg.eigh(normal)
        keep = np.argsort(size)[::-1][:DIRECTIONS]
        spreads.append(spread @ axes[:, [k for k in keep if size[k] > WEAK] or keep[:1]])
    return replace(contest, spreads=tuple(spreads))
