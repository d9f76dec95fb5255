"""The verdict: what follows from the explanations that the logs do not reject.

    none needed: NO_GAP or RETUNE        one left: NAMED        several: AMBIGUOUS        none left: UNKNOWN

A detector that found an effect for certain makes it NAMED where no further effect is needed.
"""

from __future__ import annotations

from dataclasses import dataclass

from exodrake.core.confidence import ALPHA
from exodrake.diagnosis.intervals import Fitted
from exodrake.diagnosis.isolation import Isolation, Tested
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.prune import spurious
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, RETUNE, UNKNOWN

HUNTS = 2.0  # reduced chi-square of noise alone in closed loop from which the reason says so: as much again as noise


@dataclass(frozen=True, eq=False)
class Decision:
    """A verdict.

    Attributes:
        verdict: its word.
        best: explanation behind it; the best one tried for UNKNOWN.
        left: explanations that the logs do not reject, best first.
        reasons: sentences.
        fitted: parameters of the effects of the best explanation, if it is left and has any.
    """

    verdict: str
    best: Tested
    left: tuple[Tested, ...]
    reasons: tuple[str, ...]
    fitted: Fitted | None = None


def decide(problem: Problem, found: Isolation) -> Decision:
    """The verdict of an isolation."""
    detected = tuple(d.reason for d in problem.detected if d.certain)
    fits = {t: found.fitted(t) if t.explanation.effects else None for t in found.left}
    left = tuple(
        t for t, fit in fits.items() if t in found.irreducible or not (fit and spurious(t, fit, problem.counted))
    )
    if not left and not found.left and not detected:
        return Decision(UNKNOWN, found.best, (), (rejected(found.best),))
    if not left and not detected:
        if found.retuned.levels.consistent:
            return Decision(RETUNE, found.retuned, (), ("no effect differs from its null value",))
        name = found.left[0].explanation.name
        return Decision(UNKNOWN, found.best, (), (f"an effect of the best explanation, {name}, may as well be absent",))
    if not left:
        return Decision(NAMED, found.retuned, (), (*detected, "no effect explains what is left beside it"))
    best = left[0]
    if not best.explanation.effects:
        if detected:
            return Decision(NAMED, best, left, detected)
        verdict = NO_GAP if best is found.nominal else RETUNE
        return Decision(verdict, best, left, (kept(best),))
    if len(left) == 1:
        return Decision(NAMED, best, left, (*detected, kept(best)), fits[best])
    names = ", ".join(t.explanation.name for t in left)
    return Decision(AMBIGUOUS, best, left, (*detected, f"the logs reject none of these: {names}"), fits[best])


def kept(t: Tested) -> str:
    """Reason why an explanation is kept, in one sentence."""
    p = t.levels
    if not t.explanation.effects:
        robot, law = "without an effect", "noise"
    else:
        robot, law = f"with {t.explanation.name}", "noise and the error of its law"
    hunts = (
        f"; its loop hunts, noise alone leaves a reduced chi-square of {p.hunting:.2g}" if p.hunting >= HUNTS else ""
    )
    return f"{robot} the logs differ from the robot by no more than {law} (p = {min(p.fit, *p.views):.2g}){hunts}"


def rejected(t: Tested) -> str:
    """Reason why the best explanation is rejected, in one sentence."""
    p, chi2 = t.levels, float(t.chi2[0])
    if p.burst:
        return f"{t.explanation.name} leaves too much in single windows of time alone"
    if not p.consistent:
        left = f"a reduced chi-square of {chi2:.3g}, too much (p < {ALPHA:g})"
        return f"the best explanation, {t.explanation.name}, leaves {left}"
    if p.moved > p.most_moved:
        name = t.explanation.name
        return f"the best explanation, {name}, moves nominal parameters further than their tolerances allow"
    if not p.beaten_by:
        return f"the best explanation, {t.explanation.name}, takes up too little of what a smaller one leaves"
    return f"{p.beaten_by} removes {p.share:.0%} of what the best explanation, {t.explanation.name}, leaves"


def probabilities(found: Isolation) -> dict[str, float]:
    """Weight of each tested explanation of the last size: its p-value against the sum of all."""
    tested = found.tested[-1] if found.tested else (found.retuned,)
    weights = {t.explanation.name: min(t.levels.fit, t.levels.complete) for t in tested}
    total = sum(weights.values())
    return {name: w / total if total > 0.0 else 0.0 for name, w in weights.items()}
