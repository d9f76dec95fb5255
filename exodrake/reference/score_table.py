"""A score as tables on the terminal, as JSON, and as Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from exodrake.core.markdown import markdown_table
from exodrake.core.plural import plural
from exodrake.reference.measures import Quantity
from exodrake.reference.score import Group, Score
from exodrake.reference.shares import Paired, Share

if TYPE_CHECKING:
    from rich.table import Table

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


def quantity_rows(quantities: Iterable[Quantity]) -> list[Row]:
    """Cells of the quantities that count any case."""
    return [(item.name, item.wanted, f"{item.value:.3g}", "", str(item.count)) for item in quantities if item.count]


def paired_rows(found: Iterable[Paired]) -> list[Row]:
    """Cells of the paired comparisons that count any case."""
    cells = ((item.both, item.first, item.second, item.neither, f"{item.p:.2g}", item.name) for item in found)
    return [(name, *map(str, counts)) for *counts, name in cells if any(counts[:4])]


def confusion_rows(score: Score) -> list[Row]:
    """Cells of truth against answer."""
    return [(truth, answer, "yes" if right else "", str(n)) for (truth, answer, right), n in score.confusion.items()]


def tables(score: Score) -> Iterator[tuple[str, Row, list[Row]]]:
    """Title, headings and rows of each table."""
    for group in score.groups:
        rows = share_rows(group.shares) + quantity_rows(group.quantities) + share_rows(group.baselines, "baseline: ")
        yield f"{group.name}, {counted(group.cases)}", HEADINGS, rows
        if compared := paired_rows(group.paired):
            yield f"{group.name}, paired", PAIRED, compared
    yield f"truth and answer, {title_of(score)}", CONFUSION, confusion_rows(score)


def title_of(score: Score) -> str:
    """Number of cases, of those that failed, and of those without a diagnosis."""
    lacking = f", {len(score.missing)} without a diagnosis" if score.missing else ""
    failed = f", {len(score.failed)} of them failed" if score.failed else ""
    return f"{counted(score.cases)}{failed}{lacking}"


def counted(cases: int) -> str:
    """Number of cases in words."""
    return f"{cases} {plural(cases, 'case')}"


def as_tables(score: Score) -> list[Table]:
    """Tables for the terminal; wrong answers in red."""
    from rich.table import Table

    found = []
    for title, headings, rows in tables(score):
        table = Table(title=title)
        for index, heading in enumerate(headings):
            table.add_column(heading, justify="right" if index and headings is not CONFUSION else "left")
        for row in rows:
            table.add_row(*row, style="red" if headings is CONFUSION and not row[2] else None)
        found.append(table)
    return found


def as_markdown(score: Score) -> str:
    """The score as Markdown."""
    return markdown(tables(score))


def markdown(tables: Iterable[tuple[str, Row, list[Row]]]) -> str:
    """Tables of title, headings and rows as Markdown; a heading that begins with `>` heads numbers on the right."""
    return "\n".join(f"{title}\n\n{markdown_table(headings, rows)}\n" for title, headings, rows in tables)


def as_json(score: Score) -> dict[str, Any]:
    """Plain data of the score."""
    confusion = [
        {"truth": truth, "answer": answer, "right": right, "cases": many}
        for (truth, answer, right), many in score.confusion.items()
    ]
    return {
        "cases": score.cases,
        "missing": list(score.missing),
        "failed": list(score.failed),
        "mixes": {group.name: group_json(group) for group in score.groups},
        "confusion": confusion,
    }


def group_json(group: Group) -> dict[str, Any]:
    """Plain data of the measures of a mix."""
    return {
        "cases": group.cases,
        "shares": shares_json(group.shares),
        "quantities": {
            item.name: {"value": None if math.isnan(item.value) else item.value, "cases": item.count}
            for item in group.quantities
        },
        "baselines": shares_json(group.baselines),
        "paired": {item.name: vars(item) | {"p": item.p} for item in group.paired},
    }


def shares_json(shares: Sequence[Share]) -> dict[str, Any]:
    """Plain data of shares; a share of no case has the value null."""
    found = {}
    for item in shares:
        low, high = item.interval
        value = item.value if item.total else None
        found[item.name] = {"hits": item.hits, "total": item.total, "value": value, "low": low, "high": high}
    return found
