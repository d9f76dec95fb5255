"""Expected information of a motion about rivals, each of them refitted (T-optimality; Atkinson & Fedorov 1975).

If i is true, and j is fitted to the new log and the present logs, the sum of squares left by j is

    T_ij = min_z  (d - J z)' W (d - J z) + z'z  =  d'Wd - d'WJ (1 + J'WJ)^-1 J'Wd

d: whitened difference of their logs. J: derivatives of j's log by its parameters, in units of the uncertainty that the
present logs leave (`Contest.spreads`). W: inverse variance of a sample. It holds noise and the part of both predictions
that no refit follows (variances of predictions in a design: Buzzi-Ferraris & Forzatti 1983):

    1 / w = n (1 + m_i^2 + m_j^2)         n: frames that count as one

m_i: error of the linearisation of i on plausible robots, which are drawn from the uncertainty of i after the present
logs; mean of all columns about that time. Where a finger snaps over or a carriage sticks, the least difference of two
robots moves a jump in time. T does not hold there, and such frames count little.

d'Wd, J'Wd and J'WJ add over motions, so the search for a sequence is cheap. The error of the law of i, and so the
residual of i itself, grows with the contribution of its effects: E_i = a_i^2 G_i with a_i as in the present logs. G is
the sum of squares of the contributions, times the relative error rho that a diagnosis grants the law of each effect. It
is small for a delay, whose law is known.

A diagnosis (`diagnosis.levels`) rejects j if it leaves more than the errors that its laws are granted. It also rejects
j if i takes up a share q of what j leaves above noise, unless i is a richer law of the same effects. So T must exceed

    T*_ij = max(z^2, min(G_j - E_i, E_i q / (1 - q)))

z: chance. T must also exceed q / (1 - q) times B_i + B_j, the total errors of the linearisation on these robots: where
a motion moves snaps, true laws are rejected like wrong ones. The probability of a rejection is
Phi((sqrt T - sqrt T*) / s). s^2 is 1 for noise, and more as E_i and G_j differ in a new motion. A richer law j of a
true i leaves as little as i does. It is dropped as needless where it takes up nothing, as probably as the reverse.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import permutations

import numpy as np

from exodrake.experiment.contest import Contest, Laws, contributed, effective
from exodrake.experiment.terms import Terms, terms_of

CHANCE = 4.0  # z, of the best of a hundred effects and channels at 0.3 % (normal law)
UNSURE = 0.25  # relative standard deviation of sqrt(E) in a new motion: assumed
UPPER = 0.9  # quantile of what drawn robots show: assumed
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
    """Expected information of a motion about the rival explanations.

    Attributes:
        pairs: (true, rival) -> information.
        granted: (explanations,) G of each, of the present logs and these.
        bent: (explanations,) B, what plausible changes of the parameters of each miss the linearisation by in these.
        laws: what the present logs tell of the laws.
        ended: (true, rival) -> T and changes (parameters,) of a refit that was carried to its end (`refit`).
    """

    pairs: dict[tuple[int, int], Pair]
    granted: np.ndarray
    bent: np.ndarray
    laws: Laws
    ended: dict[tuple[int, int], tuple[float, np.ndarray]] = field(default_factory=dict)

    def __add__(self, other: Information) -> Information:
        pairs = {key: pair + other.pairs[key] for key, pair in self.pairs.items()}
        granted = self.granted + other.granted - self.laws.granted
        return Information(pairs, granted, self.bent + other.bent, self.laws)

    @property
    def left(self) -> dict[tuple[int, int], float]:
        """(true, rival) -> T, the sum of squares that the refitted rival leaves."""
        return {key: self.ended[key][0] if key in self.ended else pair.left for key, pair in self.pairs.items()}

    def refit(self, true: int, rival: int) -> np.ndarray:
        """Changes (parameters,) of a refitted rival, in units of what the present logs leave uncertain."""
        return self.ended[true, rival][1] if (true, rival) in self.ended else self.pairs[true, rival].refit

    def required(self, true: int, rival: int) -> float:
        """T* without the part of chance; not below 0."""
        laws = self.laws
        excess, granted = float(laws.error[true] ** 2 * self.granted[true]), float(self.granted[rival])
        more = laws.share / (1.0 - laws.share)
        beaten = np.inf if laws.richer[true, rival] else excess * more
        return max(min(beaten, granted - excess), float(self.bent[true] + self.bent[rival]) * more)

    def beyond(self, true: int, rival: int) -> float:
        """Excess of sqrt T over sqrt T* in standard deviations."""
        if self.laws.richer[rival, true]:
            true, rival = rival, true
        required = np.sqrt(self.required(true, rival))
        distance = np.sqrt(self.left[true, rival]) - max(CHANCE, required)
        return float(distance / np.hypot(1.0, UNSURE * required))

    @property
    def criterion(self) -> tuple[float, float]:
        """Objective of the search: logarithm of the product of all probabilities, then the least `beyond`."""
        from scipy.stats import norm

        beyond = [self.beyond(*key) for key in self.pairs]
        return float(np.sum(norm.logcdf(beyond))), min(beyond)

    @property
    def closest(self) -> tuple[int, int]:
        """The (true, rival) of least `beyond`; of two laws of the same effects the richer one counts as true."""
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


def information(contest: Contest, reference: np.ndarray) -> Information | None:
    """Expected information of a reference (frames, references) [SI]; None if a run does not reach its end."""
    terms = terms_of(contest, reference)
    return information_of(contest, terms) if terms else None


def information_of(contest: Contest, terms: Terms) -> Information | None:
    """Expected information of a motion from its runs; None if a run without an effect is not finite."""
    rows, frames, laws = terms.rows, effective(terms.likelihood), contest.laws
    errors = [
        sum(float(np.sum(part**2)) for part in contributed(terms.likelihood, e, row).values())
        for e, row in zip(contest.explanations, rows, strict=True)
    ]
    if not np.isfinite(errors).all():
        return None
    bent = np.array([float(np.quantile(np.sum(part, axis=1), UPPER)) for part in terms.missed])
    pairs = {
        (i, j): pair_of(rows[j] - rows[i], -terms.columns[j], terms.weights(i, j))
        for i, j in permutations(range(len(rows)), 2)
    }
    return Information(pairs, laws.granted + laws.own * np.array(errors) / frames, bent / frames, laws)


def reduced(contest: Contest, pilot: Information) -> Contest:
    """The contest with the directions alone in which a refit changes a pilot motion, for a quick search."""
    spreads = []
    for j, spread in enumerate(contest.spreads):
        normal = next(pair.normal for (_, rival), pair in pilot.pairs.items() if rival == j)
        size, axes = np.linalg.eigh(normal)
        keep = np.argsort(size)[::-1][:DIRECTIONS]
        spreads.append(spread @ axes[:, [k for k in keep if size[k] > WEAK] or keep[:1]])
    return replace(contest, spreads=tuple(spreads))
