"""Scores of diagnoses against committed labels: the table of diagnosis.md, "How it is judged"."""

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from exodrake.blind.commitment import COMMITMENT, read_committed
from exodrake.blind.matching import accepted_blocks, accepted_ids, covered, found_ids, top_id
from exodrake.blind.run import ANSWER, FAILED, cases_of
from exodrake.core.errors import InputError

VISIBLE = 2.0  # noise standard deviations
NO_EFFECT = ("NO_GAP", "RETUNE")
FAILURE = "FAILED"  # in place of a verdict
PATIENCE = 60.0  # s


@dataclass(frozen=True)
class Share:
    """So many of so many, with its exact binomial interval; `wanted` as diagnosis.md puts it."""

    name: str
    hits: int
    total: int
    wanted: str = ""

    @property
    def value(self):
        return self.hits / self.total if self.total else float("nan")

    @property
    def interval(self):
        return binomial_interval(self.hits, self.total)


@dataclass(frozen=True)
class Score:
    """Measures of a set.

    Attributes:
        shares, baselines: proportions with intervals.
        quantities: name -> value.
        confusion: (truth, answer) -> count.
        missing, failed: names of the cases without a diagnosis, and of those that failed (counted in `cases`).
    """

    shares: tuple[Share, ...]
    quantities: dict[str, float]
    baselines: tuple[Share, ...]
    confusion: dict[tuple[str, str], int]
    missing: tuple[str, ...]
    cases: int
    failed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Answered:
    """One case: its label and its diagnosis."""

    name: str
    label: dict
    diagnosis: dict

    @property
    def kind(self):
        return self.label["kind"]

    @property
    def truths(self):
        return self.label["effects"]

    @property
    def verdict(self):
        return self.diagnosis["verdict"]

    @property
    def visible(self):
        return bool(self.truths) and min(truth["gap"] for truth in self.truths) >= VISIBLE


def binomial_interval(hits, total):
    """Exact (Clopper-Pearson) 95 % interval of a share; (0, 1) for no trials."""
    from scipy.stats import binomtest

    return tuple(map(float, binomtest(hits, total).proportion_ci(0.95))) if total else (0.0, 1.0)


def share(name, outcomes, wanted=""):
    """Share of true outcomes."""
    outcomes = list(outcomes)
    return Share(name, sum(map(bool, outcomes)), len(outcomes), wanted)


def read_answers(folder, labels):
    """Cases with a diagnosis or a reason why there is none (verdict FAILED: wrong wherever it counts), and the names
    of the others. InputError for labels that changed, a foreign case, a malformed diagnosis, or answers of several
    configurations.
    """
    truths = read_committed(labels, Path(folder) / COMMITMENT)
    answered, missing = [], []
    for case in cases_of(folder):
        if case.name not in truths:
            raise InputError(f"{case}: not among the labels in {labels}")
        path = case / ANSWER
        if not path.is_file() and (case / FAILED).is_file():
            answered.append(Answered(case.name, truths[case.name], {"verdict": FAILURE}))
            continue
        if not path.is_file():
            missing.append(case.name)
            continue
        try:
            diagnosis = json.loads(path.read_text())
            answered.append(Answered(case.name, truths[case.name], diagnosis | {"verdict": diagnosis["verdict"]}))
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{path}: not a diagnosis (JSON with key 'verdict')") from None
    missing += sorted(set(truths) - {case.name for case in cases_of(folder)})
    check_configurations(answered, folder)
    if not answered:
        raise InputError(f"{folder}: no case has a diagnosis yet; run `exodrake blind run` first")
    return answered, tuple(missing)


def check_configurations(answered, folder):
    """InputError if the diagnoses were made with several versions or thresholds."""
    from exodrake.core.provenance import described

    found = {described(case.diagnosis.get("configuration")) for case in answered if case.verdict != FAILURE}
    if len(found) > 1:
        raise InputError(
            f"{folder}: answered with several configurations ({'; '.join(sorted(found))}); `blind run --redo`"
        )


def right_block(case):
    return (case.diagnosis.get("where") or {}).get("block") in accepted_blocks(case.truths[0])


def right_effect(case):
    """The truth (or what cannot be told from it) comes first, or is in the class of an AMBIGUOUS verdict."""
    accepted = accepted_ids(case.truths[0])
    if case.verdict == "AMBIGUOUS" and accepted & set(case.diagnosis.get("equivalents") or ()):
        return True
    return case.verdict in ("NAMED", "AMBIGUOUS") and top_id(case.diagnosis) in accepted


def right_pair(case):
    """Every effect of the case is among those named."""
    found = found_ids(case.diagnosis)
    return case.verdict in ("NAMED", "AMBIGUOUS") and all(accepted_ids(truth) & found for truth in case.truths)


def names_too_much(case):
    """An effect is named that is not among those of the case."""
    accepted = set().union(*map(accepted_ids, case.truths))
    return not {effect["id"] for effect in case.diagnosis.get("effects") or ()} <= accepted


def shares_of(cases):
    """The rows of the table that are shares."""
    single = [case for case in cases if case.kind == "single" and case.visible]
    pairs = [case for case in cases if case.kind == "pair" and case.visible]
    healthy = [case for case in cases if case.kind == "healthy"]
    outside = [case for case in cases if case.kind == "unknown" and case.visible]
    named = [case for case in single + pairs if case.verdict == "NAMED"]
    right = [case for case in single if right_effect(case) and case.verdict == "NAMED"]
    inside = [hit for case in right for hit in covered(case.truths[0], case.diagnosis, exact=True)]
    loose = [hit for case in right for hit in covered(case.truths[0], case.diagnosis, exact=False)]
    lows = [overall(case).get("low") for case in named]
    return (
        share("right block first", map(right_block, single), ">= 95 %"),
        share("right effect first or in its class", map(right_effect, single), ">= 90 %"),
        share("both effects of a pair", map(right_pair, pairs), ">= 80 %"),
        share("false alarm on healthy", (case.verdict not in NO_EFFECT for case in healthy), "<= 2 %"),
        share("UNKNOWN on outside effects", (case.verdict == "UNKNOWN" for case in outside), ">= 90 %"),
        share("wrongly UNKNOWN", (case.verdict == "UNKNOWN" for case in healthy + single + pairs), "<= 5 %"),
        share("missed (NO_GAP or RETUNE) though visible", (case.verdict in NO_EFFECT for case in single + pairs)),
        share("another effect named, or one too many", map(names_too_much, named)),
        share("lower bound of closure > 0.8 when named", (low is not None and low > 0.8 for low in lows), "all"),
        share("90 % interval covers, same parameter", inside, "85-95 %"),
        share("90 % interval covers, other functional form", loose),
        share(
            f"done within {PATIENCE:.0f} s",
            ((case.diagnosis.get("seconds") or np.inf) <= PATIENCE for case in cases),
            "all",
        ),
    )


def overall(case):
    return (case.diagnosis.get("closure") or {}).get("overall") or {}


def quantities_of(cases):
    """Rows of the table that are plain quantities."""
    named = [
        overall(case).get("value") for case in cases if case.verdict == "NAMED" and case.kind in ("single", "pair")
    ]
    closures = [value for value in named if value is not None]
    seconds = [case.diagnosis["seconds"] for case in cases if case.diagnosis.get("seconds") is not None]
    quantities = {
        "closure when named, median (wanted >= 0.95)": float(np.median(closures)) if closures else float("nan")
    }
    quantities["closure when named, lowest"] = min(closures, default=float("nan"))
    classes = [len(found_ids(case.diagnosis)) for case in cases if case.verdict == "AMBIGUOUS"]
    quantities["AMBIGUOUS cases"] = len(classes)
    quantities["ids in an AMBIGUOUS class, mean"] = float(np.mean(classes)) if classes else float("nan")
    quantities["seconds a case, median"] = float(np.median(seconds)) if seconds else float("nan")
    quantities["seconds a case, longest"] = max(seconds, default=float("nan"))
    return quantities


def baselines_of(cases):
    """Trivial answers on the same visible single-effect cases: always the commonest effect, always its block, and any
    the diagnosis carries.
    """
    single = [case for case in cases if case.kind == "single" and case.visible]
    ids = Counter(case.truths[0]["id"] for case in single)
    blocks = Counter(case.truths[0]["block"] for case in single)
    rows = [
        Share("always the commonest effect", max(ids.values(), default=0), len(single)),
        Share("always the commonest block", max(blocks.values(), default=0), len(single)),
    ]
    for name in sorted({name for case in single for name in case.diagnosis.get("baselines") or ()}):
        answers = [((case.diagnosis.get("baselines") or {}).get(name), case) for case in single]
        rows.append(
            share(f"{name}: right effect", (answer in accepted_ids(case.truths[0]) for answer, case in answers))
        )
    return tuple(rows)


def confusion_of(cases):
    """(truth, answer) -> count; pairs are joined by +, an answer without a name is its verdict."""
    table = Counter()
    for case in cases:
        truth = " + ".join(effect["id"] for effect in case.truths) or "healthy"
        named = " + ".join(effect["id"] for effect in case.diagnosis.get("effects") or ())
        answer = named if case.verdict in ("NAMED", "AMBIGUOUS") and named else case.verdict
        table[truth, answer] += 1
    return dict(sorted(table.items()))


def score(folder, labels):
    """Score of a set. InputError for labels that changed, a foreign case, a malformed diagnosis, or none at all."""
    cases, missing = read_answers(folder, labels)
    failed = tuple(case.name for case in cases if case.verdict == FAILURE)
    counts = confusion_of(cases)
    return Score(shares_of(cases), quantities_of(cases), baselines_of(cases), counts, missing, len(cases), failed)
