"""Three decision rules on the same fits: smallest residual, cross-validated excess, log evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from exodrake.diagnosis.isolation import Isolation
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, PARTLY, RETUNE, UNKNOWN
from exodrake.diagnosis.search import GAIN, Fitted
from exodrake.diagnosis.verdict import MOST, decide


@dataclass(frozen=True)
class Answer:
    """What a rule says of a case.

    Attributes:
        verdict: its word.
        causes: ids of the effects that it calls causes.
        rivals: cause -> effects that would explain as much in its place.
        refinements: further effects of the set.
        left: share of the gap beyond retuning that remains.
        parameters: full name -> value of the fitted parameters of all effects.
    """

    verdict: str
    causes: list[str] = field(default_factory=list)
    rivals: dict[str, list[str]] = field(default_factory=dict)
    refinements: list[str] = field(default_factory=list)
    left: float = 1.0
    parameters: dict[str, float] = field(default_factory=dict)


def healthy(found: Isolation) -> Answer | None:
    """NO_GAP or RETUNE where the nominal or the retuned robot leaves a negligible gap."""
    if found.negligible(found.nominal.robot):
        return Answer(NO_GAP)
    return Answer(RETUNE) if found.negligible(found.retuned.explanation.robot) else None


def smallest_residual(found: Isolation) -> Answer:
    """The single effect that leaves least, always named."""
    singles = [f for f in found.search.sets.values() if len(f.effects) == 1]
    if (known := healthy(found)) or not singles:
        return known or Answer(UNKNOWN)
    best = min(singles, key=lambda f: float(np.mean(np.log(np.maximum(f.chi2, 1.0)))))
    return Answer(NAMED, sorted(best.effects), left=found.search.left(best))


def cross_validated(found: Isolation) -> Answer:
    """Forward selection by the excess of each log that the others predict, linear about each fit."""
    if known := healthy(found):
        return known

    def excess(f: Fitted) -> float:
        chi2 = f.model.leave_out(f.model.log)
        return float(np.mean(np.maximum(np.nanmean(chi2, axis=0) - 1.0, 0.0)))

    best = found.retuned
    none = left = excess(best)
    for size in range(1, 1 + max(map(len, found.search.sets))):
        sets = [f for f in found.search.sets.values() if len(f.effects) == size and best.effects <= f.effects]
        larger = min(sets, key=excess, default=None)
        if larger is None or excess(larger) > (1.0 - GAIN) * left:
            break
        best, left = larger, excess(larger)
    word = NAMED if best.effects and left < 0.1 * none else PARTLY if best.effects and left < MOST * none else UNKNOWN
    return Answer(word, sorted(best.effects), left=left / max(none, 1e-9))


def log_evidence(found: Isolation) -> Answer:
    """The set of largest evidence, with rivals in the place of each cause (`verdict.decide`)."""
    decided = decide(found)
    e = decided.best.explanation
    values = {}
    for p, x in zip(e.parameters, e.x, strict=True):
        if p.effect:
            channel = f".{p.channels[0]}" if len(p.channels) == 1 and p.channels[0] else ""
            values[p.name + channel] = p.value(float(x))
    return Answer(
        decided.verdict,
        [p.effect for p in decided.causes],
        {p.effect: sorted(p.rivals) for p in decided.causes if p.rivals},
        [p.effect for p in decided.parts if p not in decided.causes],
        decided.remainder.value,
        values,
    )


RULES = {"smallest residual": smallest_residual, "cross-validated": cross_validated, "log evidence": log_evidence}


def score(answer: Answer, truth: Sequence[str]) -> dict[str, bool]:
    """Rows of the table that a simulated case counts in -> whether the answer is right."""
    outside = any(i.startswith("outside.") for i in truth)
    named = answer.verdict in (NAMED, AMBIGUOUS)
    if not truth:
        return {"healthy without alarm": answer.verdict in (NO_GAP, RETUNE)}
    if outside:
        return {"outside the library not named": not named}
    exact = named and set(answer.causes) == set(truth) and not answer.rivals
    classes = [{cause, *answer.rivals.get(cause, [])} for cause in answer.causes]
    covered = named and len(classes) == len(truth) and all(any(t in c for c in classes) for t in truth)
    kind = "one effect" if len(truth) == 1 else "two effects"
    return {f"{kind}, exactly": exact, f"{kind}, in class": exact or covered}
