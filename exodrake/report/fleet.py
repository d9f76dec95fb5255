"""The report of a fleet: which robots, which causes, since when.

rows = read_answers("answers")
write_text("fleet.html", fleet_html(rows, "answers"))
"""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import numpy as np
from markupsafe import Markup

from exodrake import __version__
from exodrake.core.errors import plural
from exodrake.diagnosis.change_point import RAMP, STEP
from exodrake.diagnosis.fleet import Row, Trend, find_trends
from exodrake.diagnosis.many import ANSWER, FAILED, FAILURE, REPORT
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, PARTLY, RETUNE, UNKNOWN, Interval
from exodrake.report import wording as w
from exodrake.report.blocks import Bars, Table, render, timeline

WORST_FIRST = (UNKNOWN, PARTLY, NAMED, AMBIGUOUS, FAILURE, RETUNE, NO_GAP)  # order of robots by their last verdict
GREY = "#475467"  # of failures and of verdicts that a newer version gave
CELLS = 60  # of a robot's strip of verdicts
DRAWN = 24  # trends that are drawn
LISTED = 30  # failed cases that are listed
CAUSES = 15  # that have a bar


class Member(NamedTuple):
    """A robot of the fleet."""

    serial: str  # its number
    rows: list[Row]  # its cases by date
    last: Row  # its last case that has an answer, or the last of all
    changes: list[Trend]  # trends of the amplitudes of its causes that have a change, the clearest first


def members(rows: Sequence[Row]) -> list[Member]:
    """Robots with their cases, those whose last verdict is worst first; one of a newer version, unknown here, leads."""
    place, found = {verdict: k for k, verdict in enumerate(WORST_FIRST)}, []
    for serial, cases in groupby(rows, key=lambda row: row.serial):
        own = list(cases)
        last = next((row for row in reversed(own) if row.verdict != FAILURE), own[-1])
        found.append(Member(serial, own, last, [trend for trend in find_trends(own) if trend.change is not None]))
    return sorted(found, key=lambda m: (place.get(m.last.verdict, -1), m.serial))


def fleet_html(rows: Sequence[Row], source: str, links: Mapping[str, str] | None = None) -> str:
    """The report of a fleet; links: case -> address of its report or answer, as seen from the report."""
    robots = members(rows)
    failed = [(row.case, row.reason) for row in rows if row.verdict == FAILURE]
    ill = [m for m in robots if m.last.verdict not in (NO_GAP, RETUNE, FAILURE)]
    times, changed = [row.run_time for row in rows if np.isfinite(row.run_time)], sum(bool(m.changes) for m in robots)
    tiles = [
        (str(len(robots)), plural(len(robots), "robot")),
        (f"{len(rows):,}", plural(len(rows), "case")),
        (str(len(ill)), plural(len(ill), "robot") + " with a gap in the last case"),
        (str(changed), plural(changed, "robot") + " with a dated change"),
        (str(len(failed)), plural(len(failed), "case") + " without an answer"),
        *([(f"{np.median(times):.1f} s", "a case, median")] if times else []),
    ]
    timelines = []
    for trend in [t for m in robots for t in m.changes][:DRAWN]:
        name = f"{trend.serial}: {trend.effect} {trend.parameter}" + (f" on {trend.channel}" if trend.channel else "")
        lines: dict[str, list[float]] = dict.fromkeys(("values", "low", "high"), trend.values.tolist())
        timelines.append(timeline(name, trend.first, trend.unit, trend.times.tolist(), lines, trend.change))
    now = Counter(effect for m in robots for effect in m.last.effects)
    ever = Counter(effect for m in robots for row in m.rows for effect in set(row.effects))
    most, bars = max([1, *now.values()]), []
    for e in sorted(ever, key=lambda e: (-now[e], -ever[e]))[:CAUSES]:
        counts = f"{now[e]} {plural(now[e], 'robot')}, {ever[e]:,} {plural(ever[e], 'case')}"
        bars.append((f"`{e}`", now[e] / most, counts, now[e] > 0))
    if len(failed) > LISTED:
        failed[LISTED:] = [("…", f"and {len(failed) - LISTED} more")]
    dates = [row.date.date().isoformat() for row in rows if row.date is not None]
    verdicts = tuple(dict.fromkeys((*w.COLOURS, FAILURE, *sorted({row.verdict for row in rows}))))
    return render(
        "fleet.html", title=f"Fleet: {source}", version=__version__, colour=w.COLOURS[NAMED], source=source,
        tiles=tiles, colours=dict.fromkeys(verdicts, GREY) | w.COLOURS, verdicts=verdicts,
        strips=[(m.serial, strip(m.rows)) for m in robots], robots=robot_table(robots, links),
        causes=Bars(bars) if bars else None,
        timelines=timelines, rest=sum(len(m.changes) for m in robots) - len(timelines),
        failed=Table(("Case", "Reason"), failed, words=2) if failed else None,
        dates=(min(dates), max(dates)) if dates else None,
    )  # fmt: skip


def strip(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Verdicts over time: (verdict that is most frequent, words) of at most `CELLS` groups of consecutive cases."""
    cells = []
    for group in np.array_split(np.arange(len(rows)), min(CELLS, len(rows))):
        own = rows[int(group[0]) : int(group[-1]) + 1]
        counts = Counter(row.verdict for row in own).most_common()
        ends = [row.date.date().isoformat() if row.date else row.case for row in (own[0], own[-1])]
        when = ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"
        cells.append((counts[0][0], f"{when}: " + ", ".join(f"{count} {verdict}" for verdict, count in counts)))
    return cells


def find_reports(answers: Mapping[str, Path], page: Path) -> dict[str, str]:
    """Case -> address of the report beside its answer, else of the answer, as seen from a page; none of a failure."""
    found = {}
    for case, file in ((case, file) for case, file in answers.items() if file.name != FAILED):
        report = file.with_name(REPORT)
        shown = report if file.name == ANSWER and report.is_file() else file
        found[case] = quote(os.path.relpath(shown, page.resolve().parent))
    return found


def robot_table(robots: Sequence[Member], links: Mapping[str, str] | None = None) -> Table:
    """Robots: last verdict and cause, its change, size and closure; the last case with a link, number of cases."""
    rows = []
    for m in robots:
        row, counts = m.last, Counter(effect for row in m.rows for effect in row.effects)
        causes = row.effects or tuple(effect for effect, _ in counts.most_common(1) if m.changes)
        cause = w.join_words([f"`{effect}`" for effect in causes], "or" if row.verdict == AMBIGUOUS else "and")
        trend = next((t for t in m.changes if t.effect in causes), next(iter(m.changes), None))
        since, size = "–", "–"
        if trend is not None and (change := trend.change) is not None:
            _, low, high = map(trend.moment, change.began)
            since = low if low == high else f"{low} to {high}"
            if change.began[1] <= trend.times[0] and change.shape != STEP:
                since = f"before {high}"
            size = " to ".join(w.quantity(item[0], trend.unit) for item in (change.before, change.after))
            size += f", {w.quantity(change.rate[0], trend.unit)} a day" if change.shape == RAMP else ""
        sizes = []
        for a in (a for a in row.amounts if a.effect in row.effects):
            interval = Interval(a.value, a.low, a.high, a.unit)
            if w.says_something(interval):
                sizes.append(f"{a.parameter}{f' {a.channel}' if a.channel else ''} {' ('.join(w.interval(interval))})")
        verdict = row.verdict + (" (not confirmed)" if row.confirmed is False else "")
        verdict += f": the error {w.closure(row.closure)}" if w.rounds_below(row.closure) else ""
        closed = w.closure(row.closure) if np.isfinite(row.closure) else "–"
        last, address = row.date.date().isoformat() if row.date else "", (links or {}).get(row.case)
        last = Markup('<a href="{}">{}</a>').format(address, last or "report") if address else last or "–"
        amounts = "; ".join(sizes) or "–"
        rows.append((m.serial, verdict, cause or "–", since, size, amounts, closed, last, f"{len(m.rows):,}"))
    header = ("Robot", "Last verdict", "Cause", "Since when (90 %)", "Change", "Size (90 %)", "Closure")
    return Table((*header, "Last case", "Cases"), rows, words=8)
