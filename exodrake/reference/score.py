"""Scores of the answers to a blind set against its committed labels; as tables, JSON and Markdown."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from exodrake.core.errors import markdown_table, plural
from exodrake.reference.answers import FAILURE, read_answers, read_labels
from exodrake.reference.measures import (
    Paired,
    Quantity,
    Share,
    compute_baselines,
    compute_quantities,
    compute_shares,
    named_ids,
    paired,
    right,
)


@dataclass(frozen=True)
class Group:
    """Measures of the cases of one mix."""

    # name, cases: Of the mix, and how many there are
    name: str
    cases: int
    # shares, quantities: Measures that are shares of cases, and others
    shares: tuple[Share, ...]
    quantities: tuple[Quantity, ...]
    baselines: tuple[Share, ...]  # Trivial answers to the cases with one effect
    paired: tuple[Paired, ...]  # The diagnosis against the baselines that it carries, then against the other answers


@dataclass(frozen=True)
class Score:
    """Measures of a set."""

    groups: tuple[Group, ...]  # Measures of each mix
    # (truth, answer, whether it is right) -> number of cases; several effects are joined by +, an answer without a name
    # is its verdict
    confusion: dict[tuple[str, str, bool], int]
    # missing, failed: Names of the cases without a diagnosis, and of those that failed
    missing: tuple[str, ...]
    cases: int  # Number of cases that were answered, or failed
    failed: tuple[str, ...] = ()


def score(folder: str | Path, labels: str | Path, against: str | Path | None = None) -> Score:
    """Score the answers in the folder of a set by its labels file, and compare them with those of another folder.

    InputError for labels that changed, a foreign case, a malformed diagnosis, or none at all.
    """
    truths = read_labels(Path(folder), Path(labels))
    cases = read_answers(Path(folder), truths)
    others = read_answers(Path(against), truths) if against else ()
    groups, confusion = [], Counter()
    for mix in dict.fromkeys(case.mix for case in cases):
        here, there = ([case for case in answers if case.mix == mix] for answers in (cases, others))
        shares, baselines = compute_shares(here), compute_baselines(here)
        first = next(item for item in shares if item.name == "truth first")
        compared = [paired(first, item, f"truth first; {item.name}") for item in baselines if "names" in item.name]
        compared += [paired(one, other) for one, other in zip(shares, compute_shares(there))] if there else []
        groups.append(Group(mix, len(here), shares, compute_quantities(here), baselines, tuple(compared)))
    for case in cases:
        truth = " + ".join(effect["id"] for effect in case.truths) or "healthy"
        named = " + ".join(named_ids(case.diagnosis))
        answer = named if case.verdict in ("NAMED", "AMBIGUOUS") and named else case.verdict
        answer = f"PARTLY: {named}" if case.verdict == "PARTLY" else answer
        confusion[truth, answer, right(case)] += 1
    missing = tuple(sorted(set(truths) - {case.name for case in cases}))
    failed = tuple(case.name for case in cases if case.verdict == FAILURE)
    return Score(tuple(groups), dict(sorted(confusion.items())), missing, len(cases), failed)


HEADINGS = ("measure", "wanted", "found", "95 % interval", "of")
PAIRED = ("paired, McNemar", "both", "first alone", "second alone", "neither", "p")
CONFUSION = ("truth", "answer", "right", "cases")
Row = tuple[str, ...]


def share_rows(shares: Iterable[Share], prefix: str = "") -> list[Row]:
    """Cells of the shares that count any case."""
    rows = []
    for item in shares:
        low, high = item.interval
        found = f"{100 * item.value:.1f} %", f"{100 * low:.1f}-{100 * high:.1f} %", f"{item.hits}/{item.total}"
        rows += [(prefix + item.name, item.wanted, *found)] if item.total else []
    return rows


def tables(score: Score) -> Iterator[tuple[str, Row, list[Row]]]:
    """Title, headings and rows of each table; rows that count no case are left out."""
    for group in score.groups:
        rows = share_rows(group.shares)
        rows += [
            (item.name, item.wanted, f"{item.value:.3g}", "", str(item.count))
            for item in group.quantities
            if item.count
        ]
        rows += share_rows(group.baselines, "baseline: ")
        yield f"{group.name}, {count_cases(group.cases)}", HEADINGS, rows
        compared = [
            (item.name, *map(str, (item.both, item.first, item.second, item.neither)), f"{item.p:.2g}")
            for item in group.paired
            if item.both or item.first or item.second or item.neither
        ]
        if compared:
            yield f"{group.name}, paired", PAIRED, compared
    failed = f", {len(score.failed)} of them failed" if score.failed else ""
    lacking = f", {len(score.missing)} without a diagnosis" if score.missing else ""
    rows = [(truth, answer, "yes" if right else "", str(n)) for (truth, answer, right), n in score.confusion.items()]
    yield f"truth and answer, {count_cases(score.cases)}{failed}{lacking}", CONFUSION, rows


def count_cases(cases: int) -> str:
    """Number of cases in words."""
    return f"{cases} {plural(cases, 'case')}"


def markdown(tables: Iterable[tuple[str, Row, list[Row]]]) -> str:
    """Tables of title, headings and rows as Markdown; a heading that begins with `>` heads numbers on the right."""
    return "\n".join(f"{title}\n\n{markdown_table(headings, rows)}\n" for title, headings, rows in tables)


def as_json(score: Score) -> dict[str, Any]:
    """Plain data of the score; a share of no case has the value null."""

    def shares_json(shares: Iterable[Share]) -> dict[str, Any]:
        return {
            item.name: {"hits": item.hits, "total": item.total, "value": item.value if item.total else None}
            | dict(zip(("low", "high"), item.interval))
            for item in shares
        }

    mixes = {
        group.name: {
            "cases": group.cases,
            "shares": shares_json(group.shares),
            "quantities": {
                item.name: {"value": None if math.isnan(item.value) else item.value, "cases": item.count}
                for item in group.quantities
            },
            "baselines": shares_json(group.baselines),
            "paired": {item.name: vars(item) | {"p": item.p} for item in group.paired},
        }
        for group in score.groups
    }
    confusion = [
        {"truth": truth, "answer": answer, "right": right, "cases": many}
        for (truth, answer, right), many in score.confusion.items()
    ]
    return {
        "cases": score.cases, "missing": list(score.missing), "failed": list(score.failed), "mixes": mixes,
        "confusion": confusion,
    }  # fmt: skip
