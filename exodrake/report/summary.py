"""A diagnosis in a terminal, to be understood in ten seconds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, RETUNE, UNKNOWN, Diagnosis, NamedEffect
from exodrake.report import words as w

if TYPE_CHECKING:
    from rich.console import Console
    from rich.panel import Panel
    from rich.table import Table

COLOURS = {NO_GAP: "green", RETUNE: "cyan", NAMED: "blue", AMBIGUOUS: "yellow", UNKNOWN: "red"}
TOP = 5  # candidates that are listed
BAR = 20  # characters of a full bar
REGIMES = 3  # conditions that are named


def print_summary(diagnosis: Diagnosis, console: Console | None = None) -> None:
    """Prints the verdict, where, which, how far and the best candidates. console: standard output if None."""
    from rich.console import Console

    console = console or Console(highlight=False)
    console.print(verdict_panel(diagnosis))
    if diagnosis.effects:
        console.print(effects_table(diagnosis))
    console.print(gap_table(diagnosis))
    for line in closing_lines(diagnosis):
        console.print(line)
    if diagnosis.candidates:
        console.print(ranking(diagnosis))


def verdict_panel(diagnosis: Diagnosis) -> Panel:
    """The verdict in a coloured box, with place and reason."""
    from rich.markup import escape
    from rich.panel import Panel

    colour = COLOURS.get(diagnosis.verdict, "white")
    lines = [f"[bold]{escape(w.headline(diagnosis))}[/bold]"]
    where = diagnosis.where
    if where.block != "none":
        place = w.seat(where.wires, where.joints)
        lines.append(f"where   {where.block}{', ' + place if place else ''}")
    if diagnosis.verdict in (UNKNOWN, AMBIGUOUS) and where.regime:
        top = sorted(where.regime.items(), key=lambda item: -item[1])[:REGIMES]
        lines.append("when    " + ", ".join(f"{name} {w.share(value)}" for name, value in top) + " of its variance")
    lines += [f"because {escape(reason)}" for reason in diagnosis.reasons]
    title = f"[bold]{diagnosis.verdict}[/bold]  {escape(diagnosis.case)}"
    return Panel("\n".join(lines), title=title, title_align="left", border_style=colour, padding=(0, 2))


def effects_table(diagnosis: Diagnosis) -> Table:
    """Effects with parameters, intervals and probability; several channels that share a parameter are told one by
    one.
    """
    table = plain_table(("effect", "parameter", ">value", ">90 % interval"))
    for effect in diagnosis.effects:
        first = True
        for name, value, span in parameter_rows(effect):
            table.add_row(f"[bold]{effect.id}[/bold]" if first else "", name, value, span)
            first = False
    return table


def parameter_rows(effect: NamedEffect) -> list[tuple[str, str, str]]:
    """Parameter (with its channel), value and interval."""
    rows = []
    for name, item in effect.parameters.items():
        channels = effect.channels.get(name, {})
        rows += [(f"{name} {channel}", *w.interval_words(one)) for channel, one in channels.items()]
        rows += [] if channels else [(name, *w.interval_words(item))]
    return rows


def gap_table(diagnosis: Diagnosis) -> Table:
    """Gap before and after per kind of signal, in its unit, with floor and closure."""
    table = plain_table(("held-out gap (RMS)", ">before", ">after", ">noise floor", ">closed"))
    for gap in w.kind_gaps(diagnosis):
        cells = [w.quantity(x, gap.unit) for x in (gap.before, gap.after, gap.floor)]
        closed = w.share(gap.closure) if gap.before > 1.1 * gap.floor else "-"
        table.add_row(w.KINDS[gap.kind].lower(), *cells, closed)
    return table


def closing_lines(diagnosis: Diagnosis) -> list[str]:
    """Closure with its interval; for an ambiguous verdict the class and the next experiment; the time it took."""
    lines = []
    if diagnosis.verdict != NO_GAP:
        closed = w.closure_words(diagnosis.closure.overall)
        lines.append(f"closure [bold]{closed}[/bold] of the gap above the floor, with the {w.after_name(diagnosis)}")
    if diagnosis.verdict == AMBIGUOUS:
        lines.append(f"class   {', '.join(w.class_of(diagnosis))}")
        lines.append(f"next    {w.experiment_words(diagnosis)}")
    return lines


def ranking(diagnosis: Diagnosis) -> Table:
    """The best candidates with bars."""
    table = plain_table(("candidate", ">gap explained", ""))
    for candidate in diagnosis.candidates[:TOP]:
        full = round(BAR * min(max(candidate.score, 0.0), 1.0))
        table.add_row(candidate.id, w.share(max(candidate.score, 0.0)), "━" * full)
    return table


def plain_table(titles: tuple[str, ...]) -> Table:
    """A table without lines; a title that begins with > heads numbers."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="dim", padding=(0, 3, 0, 0))
    for title in titles:
        table.add_column(title.lstrip(">"), justify="right" if title.startswith(">") else "left", no_wrap=True)
    return table
