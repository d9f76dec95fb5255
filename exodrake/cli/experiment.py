"""`exodrake experiment`: the motion that tells the explanations still in play apart."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from exodrake.cli.options import AnyPath, robot_option

if TYPE_CHECKING:
    from rich.console import Console

    from exodrake.experiment.contest import Contest
    from exodrake.experiment.design import Design

FILE = {"type": AnyPath(), "metavar": "FILE"}
ADVICE = (
    "no motion of the free robot within its limits tells them apart for certain; measure at a known state instead: at "
    "a mechanical stop for the zero of an encoder, under known weights for a force, a clamped joint for a stiffness"
)


@click.command()
@click.argument("case", type=AnyPath())
@click.option(
    "--out", default=Path("reference.csv"), show_default=True, help="References to be sent to the robot.", **FILE
)
@click.option("--figure", default=None, help="Figure (PNG) [beside --out].", **FILE)
@click.option("--case", "folder", default=None, help="Folder of the case, for an answer that lies elsewhere.", **FILE)
@click.option("--duration", type=float, default=None, help="Length of the experiment, 20 to 60 s [60].")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the search.")
@robot_option()
def command(
    case: Path, out: Path, figure: Path | None, folder: Path | None, duration: float | None, seed: int, robot: str
) -> None:
    """Design the experiment that tells apart the explanations that the logs of CASE do not reject.

    CASE is a folder of logs, whose diagnosis.json is used if it is up to date, or an answer (`diagnose --json`). The
    motion is the one on which they differ most after each is fitted to it, safe on every one of them. Its log, saved as
    experiment.csv in the folder of the case, decides the next diagnosis.
    """
    from rich.console import Console

    from exodrake.cli.diagnose import check_target
    from exodrake.core.progress import stages
    from exodrake.core.threads import one_blas_thread
    from exodrake.experiment.answer import in_play
    from exodrake.experiment.contest import contest_of
    from exodrake.experiment.design import design
    from exodrake.experiment.motion import check_length
    from exodrake.machines.robot_file import load_robot

    picture, nominal = figure or out.with_suffix(".png"), load_robot(robot)
    check_target(out)
    check_target(picture)
    check_length(nominal, duration)
    with stages() as progress:
        found = in_play(case, nominal, folder, progress)
    if found.why_none:
        click.echo(found.why_none)
        return
    waiting = Console(stderr=True)
    with waiting.status("searching for the motion that tells them apart"), one_blas_thread():
        contest = contest_of(found.problem, found.rivals)
        best = design(contest, duration, seed)
    console = Console(highlight=False, width=None if waiting.is_terminal else 120)
    show(console, contest, best)
    write(contest, best, out, picture)


def write(contest: Contest, best: Design, out: Path, picture: Path) -> None:
    """Write the reference and its figure, and say what to do with them."""
    from exodrake.core.files import write_bytes
    from exodrake.data.formats import write_log
    from exodrake.experiment.figure import figure_of

    write_log(best.log(contest.problem.robot.machine), out)
    write_bytes(picture, figure_of(contest, best))
    click.echo(f"written {out} and {picture}")
    click.echo(
        "save its log as experiment.csv in the folder of the case (in its case.yaml: role fit), and diagnose again"
    )


def show(console: Console, contest: Contest, best: Design) -> None:
    """Print the expected information of an experiment and the ranges that its signals reach."""
    from exodrake.core.display import in_words
    from exodrake.experiment.safety import spans
    from exodrake.report.terminal import table

    rows: list[Any] = []
    for (true, rival), left in sorted(best.information.left.items()):
        rows.append(
            (contest.names[true], contest.names[rival], f"{left:.3g}", f"{best.information.power(true, rival):.0%}")
        )
    console.print(table(("if the cause is", "rejected", ">what it leaves (T)", ">probability"), rows, wrapped=0))
    console.print(f"\n[bold]{best.information.probability:.0%}[/bold] expected: all but the true cause are rejected")
    console.print(f"{best.random:.0%} promised by a random motion as long, the median of those that were tried")
    if not best.enough:
        console.print(f"[yellow]note[/yellow]    {ADVICE}")
    console.print()
    rows = []
    for span in spans(best.safety, contest.records(best.reference)):
        ends = [" to ".join(in_words(x, span.unit) for x in pair) for pair in (span.reached, span.allowed)]
        rows.append((span.signal, *ends))
    console.print(table(("signal", ">on any explanation", ">allowed"), rows))
    if best.size < 1.0:
        console.print(f"made smaller, to {best.size:.0%}, so that no signal leaves its range")
    console.print()
