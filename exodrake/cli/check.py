"""`exodrake check`: what a case is good for, before it is diagnosed."""

from pathlib import Path

import click
from rich.markup import escape

import exodrake as exo
from exodrake.cli import options

TOP, FEW = 3, 4  # effects that are listed for each; for fewer sensors


@options.command()
@click.argument("case", type=options.AnyPath())
@options.robot_option()
@click.option("--effects", "only", default="", metavar="ID,...", help="These effects only.")
@click.option("--without", default="", metavar="ID,...", help="Not these effects.")
@click.option("--out", "--figure", "figure", type=options.OutputFile("check.png"), help="Figure, or a folder for it.")
@click.option("--allow-outside", is_flag=True, help="Read logs that lie outside the folder of their case, too.")
def command(case: Path, robot: str, only: str, without: str, figure: Path | None, allow_outside: bool) -> object:
    """Say what CASE is good for: clocks, gaps, saturation, excitation, and which effects it could not tell apart.

    CASE is a folder of logs or one log. The effects are judged on its references alone, by simulating each of them at a
    typical size on the nominal robot; the measured values are not fitted.
    """
    from exodrake.core.parallel import one_blas_thread
    from exodrake.diagnosis.checks.compare import list_few
    from exodrake.diagnosis.checks.preflight import CLEAR, HIDDEN, MISTAKEN, SEEN, draw_figure, preflight
    from exodrake.model.display import find_display, percent

    nominal = exo.load_robot(robot)
    options.refuse_cases(case)
    with options.waiting("reading") as say, one_blas_thread():
        found = preflight(case, nominal, options.choose_effects(robot, only, without), allow_outside, say)

    def show(column: str, value: float) -> str:
        display = find_display(column.rsplit("_", 1)[0], nominal.machine)
        return f"{display.factor * value:.3g} {display.unit}"

    tables = {
        ("log", ">rows", ">duration", ">step", ">jitter", ">missing frames"): [
            (escape(c.file), str(c.rows), f"{c.duration:.4g} s", f"{1e3 * c.step:.4g} ms", f"{100.0 * c.jitter:.1f} %",
             str(c.missing)) for c in found.clocks
        ],
        ("channel", ">motion (std)", ">fast noise (std)", ">missing", ">at its ends"): [
            (c.column, show(c.column, c.motion), show(c.column, c.noise), f"{100.0 * c.missing:.1f} %",
             f"{100.0 * c.saturated:.1f} %")
            for c in found.channels
        ],
        ("reference", ">span", ">of its limits", ">95 % below", ">turns", ">at rest"): [
            (e.column, show(e.column, e.span), "" if e.share != e.share else percent(e.share), f"{e.band:.2g} Hz",
             str(e.reversals), percent(e.rest)) for e in found.excitations
        ],
    }  # fmt: skip
    for titles, rows in tables.items():
        options.print_table(titles, rows)
        click.echo()
    for problem in found.problems:
        click.echo(f"{click.style('note', fg='yellow')}    {problem}")
    if not found.problems:
        click.echo(f"{click.style('nothing wrong', fg='green')} with the recordings")
    click.echo()
    result, rows, clear = found.identifiability, [], []
    for effect in dict.fromkeys(d.effect for d in result.directions):
        own = [d for d in result.directions if d.effect == effect]
        seen = [d for d in own if d.seen >= SEEN]
        hidden = ", ".join(d.channel or "everywhere" for d in own if d.seen < SEEN)
        taken = list_few((name for d in seen for name in d.taken_for), TOP)
        size = ""
        if seen:  # the smallest that is seen on every channel that shows the effect; else the one that was tried
            known = all(d.smallest == d.smallest for d in seen)
            size = f"{max((d.smallest for d in seen), key=abs):.2g}" if known else f"at {seen[0].typical:.2g}"
            size = f"{size} {seen[0].unit}".removesuffix(" -")
        if hidden or taken:
            rows.append((f"[bold]{effect}[/bold]", size, hidden, taken))
        else:
            clear.append(f"{effect} ({size})")
    if rows:
        options.print_table(("effect", ">seen from", "not seen at typical size", "could be taken for"), rows, wrapped=3)
    if clear:
        click.echo(f"seen and distinguished, from the size in brackets: {', '.join(clear)}")
    click.echo(
        f"\n{len(result.select(CLEAR))} of {len(result.directions)} effects and channels are seen and distinguished, "
        f"{len(result.select(MISTAKEN))} could be mistaken, {len(result.select(HIDDEN))} are not seen"
    )
    for signal, noise, left in result.sensors[:1]:
        again = " once more, by a second sensor," if any(signal.name == c.kind for c in nominal.machine.columns) else ""
        click.echo(
            f"{signal.name}{again} would help most: measured with a noise of {noise:.2g} {signal.unit}, "
            f"{len(left.select(MISTAKEN))} could be mistaken and {len(left.select(HIDDEN))} not seen"
        )
    if result.fewer:
        rows = []
        for kinds, left in result.fewer.items():
            clear = {d.effect for d in left.select(CLEAR)}
            lost = list_few((d.effect for d in result.select(CLEAR) if d.effect not in clear), FEW)
            numbers = (str(len(left.select(state))) for state in (CLEAR, MISTAKEN, HIDDEN))
            rows.append((", ".join(kinds), *numbers, lost))
        counts = ">distinguished", ">mistaken", ">not seen"
        click.echo()
        options.print_table(("with these columns alone", *counts, "effects no longer distinguished"), rows, wrapped=4)
    if figure:
        options.write_files({figure: draw_figure(found)})
    return found._asdict() | {"case": found.case.name}
