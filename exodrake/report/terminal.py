"""Tables in a terminal, and a diagnosis that is read there at a glance."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import zip_longest
from math import isnan

from rich.cells import cell_len
from rich.console import Console
from rich.markup import escape
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from exodrake.core.progress import Stage
from exodrake.diagnosis.result import CAUSE, NO_GAP, PARTLY, UNKNOWN, Diagnosis
from exodrake.report import wording as w

TOP = 5  # candidates that are listed
SIMULATES = {"retune": Stage.RETUNE, "linearise": Stage.LINEARISE}  # simulated time by stage; the rest is of the fits
BAR = 12  # characters of a full bar
GAP = 2  # characters between columns
REGIMES = 3  # conditions that are named


def print_table(console: Console, titles: Sequence[str], rows: Iterable[Sequence[str]], wrapped: int = -1) -> None:
    """Print a table without lines. Titles that begin with `>` head numbers, aligned right; cells may hold rich markup.

    Nothing is cut: in a narrow terminal the column `wrapped` is wrapped first, then the others, at last within words.
    """
    made, rows = Table(box=None, pad_edge=False, header_style="dim", padding=(0, GAP, 0, 0)), list(rows)
    heads = [title.lstrip(">") for title in titles]
    cells = [[Text.from_markup(row[k]).plain for row in [heads, *rows] if k < len(row)] for k in range(len(titles))]
    widths = [max(cell_len(line) for cell in column for line in [*cell.splitlines(), ""]) for column in cells]
    words = [max(cell_len(word) for cell in column for word in [*cell.split(), ""]) for column in cells]
    for _ in range(sum(widths) + GAP * (len(widths) - 1) - console.width):
        spare = [width - word for width, word in zip(widths, words)]
        ranked = spare if max(spare) > 0 else widths
        first = wrapped if wrapped >= 0 and spare[wrapped] > 0 else ranked.index(max(ranked))
        widths[first] = max(widths[first] - 1, 1)
    for title, head, width in zip(titles, heads, widths):
        made.add_column(head, justify="right" if head != title else "left", overflow="fold", width=width)
    for row in rows:
        made.add_row(*row)
    console.print(made)


def print_summary(diagnosis: Diagnosis, console: Console | None = None) -> None:
    """Prints the verdict, where, which, how far and the best candidates; to standard output without a console."""
    console, where = console or Console(highlight=False), diagnosis.where
    lines = [f"[bold]{escape(w.headline(diagnosis))}[/bold]"]
    if where.block != "none":
        place = w.seat(where, diagnosis.machine)
        lines.append(f"where   {where.block}{', ' + place if place else ''}")
    if diagnosis.verdict in (UNKNOWN, PARTLY) and where.regime:
        top = sorted(where.regime.items(), key=lambda item: -item[1])[:REGIMES]
        lines.append("when    " + ", ".join(f"{name} {w.percent(value)}" for name, value in top) + " of its variance")
    if refined := w.refinement_words(diagnosis):
        lines.append(f"refined {escape(refined)}")
    lines += [f"because {escape(reason)}" for reason in diagnosis.reasons]
    title = f"[bold]{diagnosis.verdict}[/bold]  {escape(diagnosis.case)}"
    style = w.STYLES[diagnosis.verdict]
    console.print(Panel("\n".join(lines), title=title, title_align="left", border_style=style, padding=(0, 2)))
    if diagnosis.effects:
        rows = []
        for effect in diagnosis.effects:  # its parameters, by channel where there are any, then its rivals with theirs
            refined, values = "" if effect.role == CAUSE else f" [dim]{effect.role}[/dim]", list[tuple[str, ...]]()
            for name, item in effect.parameters.items():
                channels = {f"{name} {channel}": one for channel, one in effect.channels.get(name, {}).items()}
                values += [(title, *w.interval(one)) for title, one in (channels or {name: item}).items()]
            own = [(f"[bold]{effect.id}[/bold]{refined}", w.share_span(effect.share))]
            groups = [(own, values)]
            for rival in effect.rivals:
                row = f"  or {rival.id}", w.share_span(rival.share)
                if known := w.rival_values(diagnosis, effect, rival.id):
                    groups.append(([row], known))
                else:
                    own.append(row)
            pairs = [pair for group in groups for pair in zip_longest(*group)]
            rows += [(*(a or ("", "")), *(b or ("", "", ""))) for a, b in pairs]
        print_table(console, ("effect", ">of the gap", "parameter", ">value", ">90 % interval"), rows)
    rows, closes = [], diagnosis.verdict != NO_GAP
    for display, gap in w.kind_gaps(diagnosis).values():
        gaps = (gap.before, gap.after, gap.noise_std) if closes else (gap.before, gap.noise_std)
        cells = [w.quantity(x, gap.unit, display.unit) for x in gaps]
        closed = w.closure(gap.closure) if gap.before > w.SMALL * gap.noise_std else "-"
        rows.append((display.label.lower(), *cells, *([closed] if closes else [])))
    titles = (">before", ">after", ">noise std", ">closure") if closes else (">nominal", ">noise std")
    print_table(console, ("gap (RMS)", *titles), rows)
    if closes:
        closure = diagnosis.closure
        said = w.closure_words(closure.overall, "the excess error", f"with the {w.last_robot(diagnosis)}")
        console.print(f"closure [bold]{said}[/bold]")
        if diagnosis.effects and not isnan(closure.effect.value):
            console.print(f"        {w.closure_words(closure.effect, 'what retuning alone leaves')}")
        if words := w.motion_words(diagnosis):
            console.print(f"        {words}")
        errors, in_noise = w.robot_errors(diagnosis)
        unit = "noise standard deviations" if in_noise else "of the nominal robot's"
        robots = ", ".join(f"{name} {errors[key]}" for key, name in w.list_robots(diagnosis).items())
        console.print(f"error   {robots} {unit} (RMS)")
    if retuned := w.retuned_words(diagnosis):
        console.print(f"retuned {retuned}")
    if alike := w.alike_words(diagnosis):
        console.print(f"moved   {alike}")
    if diagnosis.rivals:
        console.print(f"next    {w.EXPERIMENT}")
    for k, line in enumerate(w.since_words(diagnosis)):
        console.print(f"{'since  ' if k == 0 else '       '} {escape(line)}")
    for line in w.law_lines(diagnosis.missing_law):
        console.print(escape(line))
    if diagnosis.candidates:
        rows = []
        for one in diagnosis.candidates[:TOP]:
            bar = "━" * round(BAR * min(max(one.share, 0.0), 1.0))
            rows.append((one.id or "retune", w.share(one.share), w.digits(one.chi2), f"{one.evidence:,.0f} nats", bar))
        print_table(console, ("fitted set", ">explains", ">chi-square", ">evidence", ""), rows, wrapped=0)
    for note in diagnosis.notes:
        console.print(f"[yellow]note[/yellow]    {escape(note)}")


def print_profile(diagnosis: Diagnosis, spent: Mapping[Stage, float]) -> None:
    """Prints processor time [s] by stage beside the time that it simulated."""
    simulated = dict.fromkeys(spent, 0.0)
    for name, time in diagnosis.simulated.items():
        stage = SIMULATES.get(name, Stage.FIT)
        simulated[stage] = simulated.get(stage, 0.0) + time
    rows = [(s.text, f"{spent.get(s, 0.0):.2f} s", f"{time:,.0f} s") for s, time in simulated.items()]
    taken = f"{sum(spent.values()):.2f} s in {diagnosis.run_time:.1f} s"
    rows.append(("all", taken, f"{diagnosis.simulated_time:,.0f} s"))
    print_table(Console(highlight=False), ("stage", ">processor", ">simulated"), rows)
