"""Shares of cases with exact binomial intervals, and their paired comparison (McNemar 1947, exact test)."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from dataclasses import dataclass

from exodrake.core.proportions import binomial_interval


@dataclass(frozen=True)
class Share:
    """Share of the cases in which something holds.

    Attributes:
        name: Name of the measure.
        outcomes: Case (or a part of one) -> whether it holds.
        wanted: Goal, in words.
    """

    name: str
    outcomes: Mapping[Hashable, bool]
    wanted: str = ""

    @property
    def hits(self) -> int:
        """Number of cases in which it holds."""
        return sum(map(bool, self.outcomes.values()))

    @property
    def total(self) -> int:
        """Number of cases."""
        return len(self.outcomes)

    @property
    def value(self) -> float:
        """Share; NaN for no cases."""
        return self.hits / self.total if self.total else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the share."""
        return binomial_interval(self.hits, self.total)


@dataclass(frozen=True)
class Paired:
    """Two shares on the same cases: in how many both hold, only the first, only the second, neither."""

    name: str
    both: int
    first: int
    second: int
    neither: int

    @property
    def p(self) -> float:
        """Two-sided p-value of equal shares: the cases in which one holds alone are a fair coin (McNemar)."""
        from scipy.stats import binomtest

        differing = self.first + self.second
        return float(binomtest(self.first, differing).pvalue) if differing else 1.0


def paired(first: Share, second: Share, name: str = "") -> Paired:
    """Pair two shares on the cases that both count."""
    pairs = [
        (bool(first.outcomes[key]), bool(second.outcomes[key])) for key in first.outcomes if key in second.outcomes
    ]
    cells = (pairs.count(cell) for cell in ((True, True), (True, False), (False, True), (False, False)))
    return Paired(name or first.name, *cells)
