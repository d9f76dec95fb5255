"""Tables in a terminal, and a diagnosis that is read there at a glance."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, RETUNE, UNKNOWN, Diagnosis, NamedEffect
from exodrake.report import number_format as n, wording as w
from exodrake.report.missing_law import law_lines
from exodrake.report.since import words as since_words

if TYPE_CHECKING:
    from rich.console import Console
    from rich.panel import Panel
    from rich.table import Table

COLOURS = {NO_GAP: "green", RETUNE: "cyan", NAMED: "blue", AMBIGUOUS: "yellow", UNKNOWN: "red"}
TOP = 5  # candidates that are listed
BAR = 20  # characters of a full bar
REGIMES = 3  # conditions that are named


def table(titles: Sequence[str], rows: Iterable[Sequence[str]] = (), wrapped: int = -1) -> Table:
    """A table without lines.

    Args:
        titles: of the columns; one that begins with `>` heads numbers, which are aligned right.
        rows: cells, which may hold rich markup.
        wrapped: index of the one column that may be wrapped; -1 for none.
    """
    from rich.table import Table

    made = Table(box=None, pad_edge=False, header_style="dim", padding=(0, 2, 0, 0))
    for k, title in enumerate(titles):
        justify = "right" if title.startswith(">") else "left"
        made.add_column(title.lstrip(">"), justify=justify, no_wrap=k != wrapped, ratio=1 if k == wrapped else None)
    for row in rows:
        made.add_row(*row)
    return made


def print_summary(diagnosis: Diagnosis, console: Console | None = None) -> None:
    """Prints the verdict, where, which, how far and the best candidates; to standard output without a console."""
    from rich.console import Console
    from rich.markup import escape

    console = console or Console(highlight=False)
    console.print(verdict_panel(diagnosis))
    if diagnosis.effects:
        rows = [row for effect in diagnosis.effects for row in parameter_rows(effect)]
        console.print(table(("effect", "parameter", ">value", ">90 % interval"), rows))
    console.print(gap_table(diagnosis))
    for line in closing_lines(diagnosis):
        console.print(line)
    for k, line in enumerate(since_words(diagnosis)):
        console.print(f"{'since  ' if k == 0 else '       '} {escape(line)}")
    for line in law_lines(diagnosis.missing_law):
        console.print(escape(line))
    if diagnosis.candidates:
        console.print(ranking(diagnosis))
    for note in diagnosis.notes:
        console.print(f"[yellow]note[/yellow]    {escape(note)}")


def verdict_panel(diagnosis: Diagnosis) -> Panel:
    """The verdict in a coloured box, with place and reason."""
    from rich.markup import escape
    from rich.panel import Panel

    lines = [f"[bold]{escape(w.headline(diagnosis))}[/bold]"]
    where = diagnosis.where
    if where.block != "none":
        place = w.seat(where.wires, where.joints)
        lines.append(f"where   {where.block}{', ' + place if place else ''}")
    if diagnosis.verdict in (UNKNOWN, AMBIGUOUS) and where.regime:
        top = sorted(where.regime.items(), key=lambda item: -item[1])[:REGIMES]
        lines.append("when    " + ", ".join(f"{name} {n.percent(value)}" for name, value in top) + " of its variance")
    lines += [f"because {escape(reason)}" for reason in diagnosis.reasons]
    title = f"[bold]{diagnosis.verdict}[/bold]  {escape(diagnosis.case)}"
    style = COLOURS.get(diagnosis.verdict, "white")
    return Panel("\n".join(lines), title=title, title_align="left", border_style=style, padding=(0, 2))


def parameter_rows(effect: NamedEffect) -> list[tuple[str, ...]]:
    """Effect, parameter (by channel where it has several values), value and interval."""
    rows = []
    for name, item in effect.parameters.items():
        channels = effect.channels.get(name, {})
        rows += [(f"{name} {channel}", *n.interval(one)) for channel, one in channels.items()]
        rows += [] if channels else [(name, *n.interval(item))]
    return [(f"[bold]{effect.id}[/bold]" if k == 0 else "", *row) for k, row in enumerate(rows)]


def gap_table(diagnosis: Diagnosis) -> Table:
    """Gap per kind of signal with the nominal and the last robot, noise standard deviation and closure."""
    rows, closes = [], diagnosis.verdict != NO_GAP
    for found in w.kind_gaps(diagnosis):
        gap = found.gap
        gaps = (gap.before, gap.after, gap.noise_std) if closes else (gap.before, gap.noise_std)
        cells = [n.quantity(x, gap.unit, found.display.unit) for x in gaps]
        closed = n.closure(gap.closure) if gap.before > w.SMALL * gap.noise_std else "-"
        rows.append((found.display.label.lower(), *cells, *([closed] if closes else [])))
    titles = (">before", ">after", ">noise std", ">closure") if closes else (">nominal", ">noise std")
    return table(("gap (RMS)", *titles), rows)


def closing_lines(diagnosis: Diagnosis) -> list[str]:
    """Closure with its interval; for an ambiguous verdict the class and the next experiment."""
    lines = []
    if diagnosis.verdict != NO_GAP:
        overall, rms = diagnosis.closure.overall, diagnosis.closure.rms
        said = n.closure_words(overall, "the excess error", f"with the {w.last_robot(diagnosis)}")
        lines.append(f"closure [bold]{said}[/bold]")
        step = diagnosis.closure.effect
        if diagnosis.effects and step.value == step.value:
            lines.append(f"        {n.closure_words(step, 'what retuning alone leaves')}")
        lines += [f"        {words}"] if (words := w.motion_words(diagnosis)) else []
        robots = ", ".join(f"{name} {n.digits(rms[key])}" for key, name in w.robots_of(diagnosis).items())
        lines.append(f"error   {robots} noise standard deviations (RMS)")
    if diagnosis.verdict == RETUNE:
        lines += [f"moved   {text}" if k == 0 else f"        {text}" for k, text in enumerate(w.moved_words(diagnosis))]
    if diagnosis.verdict == AMBIGUOUS:
        lines.append(f"class   {', '.join(w.class_of(diagnosis))}")
    if diagnosis.rivals:
        lines.append(f"next    {w.experiment_words(diagnosis)}")
    return lines


def ranking(diagnosis: Diagnosis) -> Table:
    """The best candidates with bars."""
    rows = []
    for candidate in diagnosis.candidates[:TOP]:
        removed = min(max(candidate.score, 0.0), 1.0)
        rows.append((candidate.id, n.percent(removed), "━" * round(BAR * removed)))
    return table(("candidate, fitted logs", ">closure beyond retuning", ""), rows, wrapped=0)


def print_profile(diagnosis: Diagnosis, console: Console | None = None) -> None:
    """Prints which stages of a diagnosis took the simulated time; to standard output without a console."""
    from rich.console import Console

    total = diagnosis.simulated_time
    rows = [(stage, f"{s:,.0f} s", n.percent(s / total)) for stage, s in diagnosis.simulated.items()]
    rows.append(("all", f"{total:,.0f} s", f"in {diagnosis.run_time:.1f} s"))
    (console or Console(highlight=False)).print(table(("stage", ">simulated", ">share"), rows))
