"""`exodrake check`: what a case is good for, before it is diagnosed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from exodrake.cli.options import AnyPath, robot_option, tried_of

if TYPE_CHECKING:
    from rich.console import Console

    from exodrake.core.robot import Robot
    from exodrake.preflight.check import Preflight
    from exodrake.preflight.directions import Direction

TOP, FEW = 3, 4  # effects that are listed for each; for fewer sensors


@click.command()
@click.argument("case", type=AnyPath())
@robot_option()
@click.option("--effects", "only", default="", metavar="ID,...", help="These effects only.")
@click.option("--without", default="", metavar="ID,...", help="Not these effects.")
@click.option("--figure", type=AnyPath(), default=None, metavar="FILE", help="Write the figure (PNG).")
@click.option("--allow-outside", is_flag=True, help="Read logs that lie outside the folder of their case, too.")
def command(case: Path, robot: str, only: str, without: str, figure: Path | None, allow_outside: bool) -> None:
    """Say what CASE is good for: clocks, gaps, saturation, excitation, and which effects it could not tell apart.

    CASE is a folder of logs or one log. The effects are judged on its references alone, by simulating each of them at a
    typical size on the nominal robot; the measured values are not fitted.
    """
    from rich.console import Console

    from exodrake.cli.diagnose import check_target
    from exodrake.core.files import write_bytes
    from exodrake.core.threads import one_blas_thread
    from exodrake.machines.robot_file import load_robot
    from exodrake.preflight.check import figure_of, preflight

    check_target(figure)
    nominal = load_robot(robot)
    waiting = Console(stderr=True)
    with waiting.status("reading") as status, one_blas_thread():

        def progress(text: str) -> None:
            status.update(f"{text} (the first run after a change compiles for half a minute)")

        found = preflight(case, nominal, tried_of(robot, only, without), allow_outside, progress)
    console = Console(highlight=False, width=None if waiting.is_terminal else 120)
    show_recordings(console, found, nominal)
    show_problems(console, found)
    show_effects(console, found)
    show_fewer(console, found)
    if figure:
        write_bytes(figure, figure_of(found))
        click.echo(f"written {figure}")


def show_recordings(console: Console, found: Preflight, robot: Robot) -> None:
    """Tables of clocks, channels and references, and what is wrong with them."""
    from rich.markup import escape

    from exodrake.core.display import display_of
    from exodrake.report.terminal import table

    def shown(column: str, value: float) -> str:
        display = display_of(column.rsplit("_", 1)[0], robot.machine)
        return f"{display.factor * value:.3g} {display.unit}"

    rows: list[Any] = []
    for c in found.clocks:
        times = f"{c.duration:.4g} s", f"{1e3 * c.step:.4g} ms", f"{c.jitter:.1%}"
        rows.append((escape(c.file), str(c.rows), *times, str(c.missing)))
    console.print(table(("log", ">rows", ">duration", ">step", ">jitter", ">missing frames"), rows))
    console.print()
    rows = [
        (c.column, shown(c.column, c.motion), shown(c.column, c.noise), f"{c.missing:.1%}", f"{c.saturated:.1%}")
        for c in found.channels
    ]
    console.print(table(("channel", ">motion (std)", ">fast noise (std)", ">missing", ">at its ends"), rows))
    console.print()
    rows = []
    for e in found.excitations:
        share = "" if e.share != e.share else f"{e.share:.0%}"
        rows.append((e.column, shown(e.column, e.span), share, f"{e.band:.2g} Hz", str(e.reversals), f"{e.rest:.0%}"))
    console.print(table(("reference", ">span", ">of its limits", ">95 % below", ">turns", ">at rest"), rows))


def show_problems(console: Console, found: Preflight) -> None:
    """Print the problems of the recordings, a line each."""
    from rich.markup import escape

    console.print()
    for problem in found.problems:
        console.print(f"[yellow]note[/yellow]    {escape(problem)}")
    if not found.problems:
        console.print("[green]nothing wrong[/green] with the recordings")


def show_effects(console: Console, found: Preflight) -> None:
    """A table of effects: smallest size that is seen, and what each could be taken for; then what would help."""
    from exodrake.preflight.directions import SEEN
    from exodrake.report.terminal import table

    result, rows = found.identifiability, []
    for effect in dict.fromkeys(d.effect for d in result.directions):
        own = [d for d in result.directions if d.effect == effect]
        seen = [d for d in own if d.seen >= SEEN]
        hidden = ", ".join(d.channel or "everywhere" for d in own if d.seen < SEEN)
        taken = list(dict.fromkeys(name for d in seen for name in d.taken_for))
        listed = ", ".join(taken[:TOP]) + (f" and {len(taken) - TOP} more" if len(taken) > TOP else "")
        rows.append((f"[bold]{effect}[/bold]", smallest(seen), hidden, listed))
    console.print()
    console.print(table(("effect", ">seen from", "not seen at typical size", "could be taken for"), rows, wrapped=3))
    console.print(
        f"\n[bold]{len(result.clear)}[/bold] of {len(result.directions)} effects and channels are seen and "
        f"distinguished, {len(result.mistaken)} could be mistaken, {len(result.hidden)} are not seen"
    )
    for sensor in result.sensors[:1]:
        console.print(
            f"[bold]{sensor.signal}[/bold] would help most: measured with a noise of {sensor.noise:.2g} {sensor.unit}, "
            f"{sensor.mistaken} could be mistaken and {sensor.hidden} not seen"
        )


def show_fewer(console: Console, found: Preflight) -> None:
    """A table of what would still be distinguished with fewer sensors."""
    from exodrake.report.terminal import table

    if not found.identifiability.fewer:
        return
    rows = []
    for item in found.identifiability.fewer:
        more = f" and {len(item.lost) - FEW} more" if len(item.lost) > FEW else ""
        counts = (len(item.left.clear), len(item.left.mistaken), len(item.left.hidden))
        rows.append((", ".join(item.kinds), *map(str, counts), ", ".join(item.lost[:FEW]) + more))
    titles = ("with these columns alone", ">distinguished", ">mistaken", ">not seen", "effects no longer distinguished")
    console.print()
    console.print(table(titles, rows, wrapped=4))


def smallest(seen: list[Direction]) -> str:
    """Smallest size that is seen on every channel that shows the effect; else the one that was tried."""
    if not seen:
        return ""
    if any(d.smallest != d.smallest for d in seen):
        return f"at {seen[0].typical:.2g} {seen[0].unit}".removesuffix(" -")
    worst = max((d.smallest for d in seen), key=abs)
    return f"{worst:.2g} {seen[0].unit}".removesuffix(" -")
