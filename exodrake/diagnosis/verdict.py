"""From fitted candidates to a verdict. Thresholds are calibrated on simulated robots (`blind/calibrate.py`) and kept in
`thresholds.yaml`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np

from exodrake.diagnosis.fit import as_one
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, RETUNE, UNKNOWN
from exodrake.diagnosis.search import PACKET_LOSS, Fitted, Search


@dataclass(frozen=True)
class Thresholds:
    """The frozen configuration of all verdicts; meanings in `thresholds.yaml`."""

    consistent: float
    consistent_column: float
    explained: float
    near: float
    half: float
    alike: float
    form: float
    margin: float
    alarm: float
    pair: float
    second: float
    far: float
    of_law: float
    distinct_of_law: float
    distinct: float
    prediction_error: float
    unpromising: float


@cache
def thresholds() -> Thresholds:
    """The calibrated thresholds."""
    import yaml

    return Thresholds(**yaml.safe_load((files("exodrake.diagnosis") / "thresholds.yaml").read_text()))


@dataclass(frozen=True, eq=False)
class Decision:
    """A verdict, the candidate behind it, its rivals (best first, itself included), probabilities, and reasons."""

    verdict: str
    best: Fitted
    rivals: tuple[Fitted, ...]
    probability: dict[str, float]
    reasons: tuple[str, ...]


def chi2(problem: Problem, fitted: Fitted) -> float:
    """Mean square residual over fitted and held-out logs alike [noise variance]."""
    a, b = len(fitted.point.residual), len(fitted.held)
    return (a * fitted.chi2 + b * fitted.holdout_chi2) / (a + b)


def signal_misfits(problem: Problem, fitted: Fitted) -> np.ndarray:
    """Mean square residual of each signal (columns,) [noise variance], over fitted and held-out logs alike."""
    both = np.concatenate([fitted.point.residual, fitted.held]).reshape(-1, len(problem.columns))
    return np.mean(both**2, axis=0)


def worst_column(problem: Problem, fitted: Fitted) -> float:
    """Mean square residual of the worst signal [noise variance]."""
    return float(np.max(signal_misfits(problem, fitted)))


def is_consistent(problem: Problem, fitted: Fitted, limits: Thresholds) -> bool:
    """Whether a robot explains a case to its noise."""
    return chi2(problem, fitted) <= limits.consistent and worst_column(problem, fitted) <= limits.consistent_column


def left_over(problem: Problem, fitted: Fitted, before: Fitted) -> float:
    """Share of the gap of `before` that `fitted` leaves."""
    gap = chi2(problem, before) - 1.0
    return max(chi2(problem, fitted) - 1.0, 0.0) / gap if gap > 0.0 else 0.0


def explains(problem: Problem, fitted: Fitted, before: Fitted, limits: Thresholds) -> bool:
    """Whether a candidate explains enough of a gap to be named: nearly all, or half of it and what is left is small."""
    left = left_over(problem, fitted, before)
    return left <= limits.explained or (left <= limits.half and chi2(problem, fitted) <= limits.near)


def probabilities(problem: Problem, candidates: list[Fitted], best: float) -> dict[str, float]:
    """Probability of each candidate: its cost tempered by the best reduced chi-square and by the frames that count as
    one.
    """
    costs = np.array([c.score for c in candidates])
    weights = np.exp(-np.minimum((costs - costs.min()) / (max(1.0, best) * as_one(problem)), 700.0))
    return {c.name: float(w) for c, w in zip(candidates, weights / weights.sum(), strict=True)}


def as_good(problem: Problem, fitted: Fitted, best: Fitted, limits: Thresholds) -> bool:
    """Whether a candidate comes so near the best that the difference may be an accident.

    Of the noise, as among effects that are not there at all; or of the law, where the best itself leaves something.
    """
    final = chi2(problem, best)
    samples = len(best.point.residual) + len(best.held)
    form = (limits.alike - 1.0) * max(final - limits.consistent, 0.0) * 0.5 * samples
    return fitted.score - best.score <= limits.margin * max(final, 1.0) + form


def simpler(fitted: Fitted, best: Fitted) -> bool:
    """Whether a candidate has fewer parameters than the best, on the same blocks."""
    blocks = [{e.split(".")[0] for e in f.point.hypothesis.effects} for f in (fitted, best)]
    return blocks[0] == blocks[1] and len(fitted.point.u) < len(best.point.u)


def decide(problem: Problem, search: Search, limits: Thresholds | None = None) -> Decision:
    """The verdict of a search."""
    limits = limits or thresholds()
    if is_consistent(problem, search.nominal, limits):
        return Decision(NO_GAP, search.nominal, (), {}, ("the nominal robot explains every signal to its floor",))
    ranked = sorted((*search.singles, *search.pairs), key=lambda f: f.score)
    best = ranked[0]
    if is_consistent(problem, search.retuned, limits) and search.retuned.score - best.score < limits.alarm:
        return Decision(
            RETUNE, search.retuned, (), {}, ("numbers within 10 % of nominal explain every signal to its floor",)
        )
    probability = probabilities(problem, ranked, chi2(problem, best))
    left, final = left_over(problem, best, search.retuned), chi2(problem, best)
    if not explains(problem, best, search.retuned, limits):
        if search.losses_evident:
            lost = next(f for f in ranked if PACKET_LOSS in f.point.hypothesis.effects)
            return Decision(
                NAMED,
                lost,
                (lost,),
                probability,
                ("commands were seen to be lost, one by one; those lost unseen leave the rest",),
            )
        why = f"the best candidate, {best.name}, leaves {left:.0%} of the gap ({final:.2g} floor^2)"
        return Decision(UNKNOWN, best, (), probability, (why,))
    same = [f for f in ranked if len(f.point.hypothesis.effects) == len(best.point.hypothesis.effects)]
    rivals = [f for f in same if as_good(problem, f, best, limits)]
    rivals += [
        f for f in same if f not in rivals and simpler(f, best) and left_over(problem, f, search.retuned) <= limits.form
    ]
    rivals.sort(key=lambda f: len(f.point.u))
    best = rivals[0]
    if len(rivals) > 1:
        return Decision(
            AMBIGUOUS,
            best,
            tuple(rivals),
            probability,
            ("these effects explain the logs equally well: " + ", ".join(f.name for f in rivals),),
        )
    return Decision(NAMED, best, tuple(rivals), probability, (f"{best.name} leaves {left:.1%} of the gap",))
