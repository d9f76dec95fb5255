"""Scores of the answers to a blind set against its committed labels, by themselves and beside other answers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from exodrake.reference.answers import FAILURE, Answered, read_answers, read_labels
from exodrake.reference.matching import named_ids
from exodrake.reference.measures import Quantity, baselines_of, quantities_of, right, shares_of
from exodrake.reference.shares import Paired, Share, paired


@dataclass(frozen=True)
class Group:
    """Measures of the cases of one mix.

    Attributes:
        name: Name of the mix.
        cases: Number of cases.
        shares: Shares of cases.
        quantities: Measures that are no shares.
        baselines: Trivial answers to the cases with one effect.
        paired: The diagnosis against the baselines that it carries, then against the other answers.
    """

    name: str
    cases: int
    shares: tuple[Share, ...]
    quantities: tuple[Quantity, ...]
    baselines: tuple[Share, ...]
    paired: tuple[Paired, ...]


@dataclass(frozen=True)
class Score:
    """Measures of a set.

    Attributes:
        groups: Measures of each mix.
        confusion: (truth, answer, whether it is right) -> number of cases.
        missing: Names of the cases without a diagnosis.
        cases: Number of cases that were answered, or failed.
        failed: Names of the cases that failed.
    """

    groups: tuple[Group, ...]
    confusion: dict[tuple[str, str, bool], int]
    missing: tuple[str, ...]
    cases: int
    failed: tuple[str, ...] = ()


def group_of(name: str, cases: Sequence[Answered], others: Sequence[Answered]) -> Group:
    """Measure the cases of a mix; `others`: other answers to the same cases."""
    shares, baselines = shares_of(cases), baselines_of(cases)
    first = next(item for item in shares if item.name == "truth first")
    carried = [paired(first, item, f"truth first; {item.name}") for item in baselines if "names" in item.name]
    against = [paired(here, there) for here, there in zip(shares, shares_of(others))] if others else []
    return Group(name, len(cases), shares, quantities_of(cases), baselines, (*carried, *against))


def confusion_of(cases: Sequence[Answered]) -> dict[tuple[str, str, bool], int]:
    """Count truths with answers; several effects are joined by +, an answer without a name is its verdict."""
    table = Counter()
    for case in cases:
        truth = " + ".join(effect["id"] for effect in case.truths) or "healthy"
        named = " + ".join(named_ids(case.diagnosis))
        answer = named if case.verdict in ("NAMED", "AMBIGUOUS") and named else case.verdict
        answer = f"PARTLY: {named}" if case.verdict == "PARTLY" else answer
        table[truth, answer, right(case)] += 1
    return dict(sorted(table.items()))


def score(folder: str | Path, labels: str | Path, against: str | Path | None = None) -> Score:
    """Score the answers to a set.

    Args:
        folder: Folder of the set, with the answers.
        labels: Labels file.
        against: Folder with other answers to the same cases, for a paired comparison.

    Returns:
        The measures, by case mix.

    Raises:
        InputError: For labels that changed, a foreign case, a malformed diagnosis, or none at all.
    """
    truths = read_labels(Path(folder), Path(labels))
    cases = read_answers(Path(folder), truths)
    others = read_answers(Path(against), truths) if against else ()
    mixes = dict.fromkeys(case.mix for case in cases)
    groups = tuple(
        group_of(mix, *([case for case in answers if case.mix == mix] for answers in (cases, others))) for mix in mixes
    )
    missing = tuple(sorted(set(truths) - {case.name for case in cases}))
    failed = tuple(case.name for case in cases if case.verdict == FAILURE)
    return Score(groups, confusion_of(cases), missing, len(cases), failed)
