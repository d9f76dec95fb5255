"""Section "since when" of the report: the change in words, and timelines for `templates/timeline.js`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any

from exodrake.data.case import parse_date
from exodrake.diagnosis.change_point import STEP, Change
from exodrake.diagnosis.result import UNKNOWN, Diagnosis, Interval
from exodrake.model.display import SYMBOLS, shown_unit
from exodrake.report import wording as w
from exodrake.report.blocks import Table

if TYPE_CHECKING:
    from exodrake.diagnosis.since import Series, Since

SHOWN = 6  # series that are drawn
STEADY = "no quantity changes over the {}"


def since(diagnosis: Diagnosis) -> dict[str, Any]:
    """Values of the section's template; nothing for a case without sessions."""
    found = diagnosis.since
    if found is None:
        return {"since": None, "timelines": []}
    first = parse_date(found.sessions[0]) if found.unit == "d" else None
    timelines = [
        timeline(title(s), first, s.unit, found.times, {"values": s.values, "low": s.low, "high": s.high}, s.change)
        for s in found.series[:SHOWN]
    ]
    rows = []
    for one in found.series:
        change, cells = one.change, ("–",) * 4
        if change is not None:
            before, after = (w.interval(Interval(*item, one.unit))[0] for item in (change.before, change.after))
            cells = (when(found, change), before, after, "–" if change.shape == STEP else speed(found, one, change))
        rows.append((title(one), *cells[:1], w.percent(one.p), *cells[1:]))
    header = ("Quantity", "Change began", "Constant by evidence", "Before", "Last", "Rate")
    table = Table(header, rows, words=2, folded=f"All {len(rows)} quantities in numbers") if rows else None
    return {"since": words(diagnosis), "timelines": timelines, "changes": table}


def words(diagnosis: Diagnosis) -> list[str]:
    """Changes over the sessions in sentences: what, when, and how much; none for a case without sessions."""
    found = diagnosis.since
    if found is None:
        return []
    if found.note:
        return [found.note]
    if found.clearest is None or found.clearest.change is None:
        spans = f"{len(found.sessions)} {'sessions' if found.unit == 'd' else 'windows of the log'}"
        return [STEADY.format(spans)]
    one, change = found.clearest, found.clearest.change
    before, after = (w.interval(Interval(*item, one.unit)) for item in (change.before, change.after))
    sizes = f"{before[0]} until then, {after[0]} ({after[1]}) in the last session"
    rate = "" if change.shape == STEP else f"; it changes by {speed(found, one, change)}"
    shapes = " or ".join(change.shapes)
    lines = [f"the change of {title(one)} began {when(found, change)}: {sizes}{rate} ({shapes})"]
    alike = [other for other in found.series if other.change is not None and other.name == one.name]
    if len(alike) > 1:
        lines.append(f"it changes, too, on {w.join_words([other.channel for other in alike[1:]])}")
    if diagnosis.verdict == UNKNOWN and found.effect:
        lines.append(
            f"no constant explanation is left, but {found.effect} alone, with a size of its own in each session, "
            f"leaves a reduced chi-square of {w.digits(found.chi2)}"
        )
    return lines


def when(found: Since, change: Change) -> str:
    """The date with its 90 % set."""
    _, low, high = (found.moment(t) for t in change.began)
    if change.began[1] <= found.times[0] and change.shape != STEP:
        return f"in the first session or before, by {high} at the latest"
    return f"about {high}" if low == high else f"between {low} and {high} (90 %)"


def speed(found: Since, one: Series, change: Change) -> str:
    """Rate by day or minute, and as a share of the value before where that is clearly not zero."""
    per, factor = ("a day", 1.0) if found.unit == "d" else ("a minute", 60.0)
    value = w.quantity(factor * change.rate[0], one.unit)
    level, low, high = change.before
    share = f", {w.percent(factor * change.rate[0] / level)} of the value before" if low * high > 0.0 else ""
    return f"{value} {per}{share}"


def title(one: Series) -> str:
    """A series in words."""
    name = "the residual’s power" if one.name == "residual" else one.name
    return f"{name} on {one.channel}" if one.channel else name


def timeline(
    title: str, first: datetime | None, unit: str, times: Sequence[float], rows: Mapping[str, Sequence[float]],
    change: Change | None,
) -> dict[str, Any]:  # fmt: skip
    """Plain data of a quantity: title, unit shown, values, and its change if it has one.

    first: date from which times count [d], shown as POSIX times [s]; None of times of a log [s]. times: (n,) of the
    values. rows: `values`, `low` and `high` (n,) [unit].
    """
    name, factor = shown_unit(unit)

    def clock(times: Sequence[float]) -> list[float]:
        return list(times) if first is None else [(first + timedelta(days=t)).timestamp() for t in times]

    found: dict[str, Any] = {"title": title, "dates": first is not None, "unit": SYMBOLS.get(name, name)}
    found |= {key: [factor * float(value) for value in values] for key, values in rows.items()}
    found["times"] = clock(times)
    if change is not None:
        found["began"] = clock(change.began)
        found["path"] = [[*clock([t]), factor * y] for t, y in change.path(times[0], times[-1])]
    return found
