"""`exodrake demo`: from a robot with a hidden fault to its name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from exodrake.cli.options import AnyPath

if TYPE_CHECKING:
    from rich.console import Console

    from exodrake.diagnosis.result import Diagnosis

GRASP = "caging"
CASE, LABELS, COMMITMENT = "case", "label.json", "commitment.txt"  # folder and files of the demo


@click.command()
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Which robot, and which fault.")
@click.option("--out", type=AnyPath(), default=Path("demo"), show_default=True, help="Folder.")
def command(seed: int, out: Path) -> None:
    """Simulate a grasp, inject a fault into an independent reference simulator, and find it from logs alone."""
    from rich.console import Console
    from rich.markup import escape

    from exodrake.core.files import check_folder

    check_folder(out)
    fresh(out)
    console = Console(highlight=False)
    chapter(console, 1, "A grasp of the nominal robot", "The model closes an index finger by three tendons.")
    grasp(console, out / "grasp")
    chapter(console, 2, "A robot with a hidden fault", HIDDEN)
    hide(console, out, seed)
    chapter(console, 3, "The diagnosis", "Only the logs and the nominal robot are known. This takes a minute or two.")
    found = diagnose(out)
    chapter(console, 4, "The label", "Now the label is read, and checked against its SHA-256 commitment.")
    reveal(console, out, found)
    shown = escape(str(out))
    console.print(f"\n[bold]look at[/bold]  {shown}/grasp/recording.html   the finger in 3D", soft_wrap=True)
    console.print(f"         {shown}/report.html   the diagnosis", soft_wrap=True)
    console.print(f"         {shown}/robot.yaml   the fitted robot, for exodrake simulate --robot", soft_wrap=True)


HIDDEN = (
    "Another simulator, with other equations, other numbers within 3 % and one effect that the nominal robot lacks, "
    "writes five logs. The label is committed to by its SHA-256."
)


def chapter(console: Console, number: int, title: str, words: str) -> None:
    """Heading of a chapter, and what happens in it."""
    from rich.padding import Padding

    console.print(f"\n[bold]{number}  {title}[/bold]")
    console.print(Padding(f"[dim]{words}[/dim]", (0, 0, 0, 3)))


def fresh(out: Path) -> None:
    """InputError if the folder holds an earlier demo, which is not overwritten."""
    from exodrake.core.errors import InputError

    if (out / CASE).exists() or (out / LABELS).exists():
        raise InputError(f"{out}: holds an earlier demo; name another folder with --out, or remove it")


def grasp(console: Console, folder: Path) -> None:
    """Simulates a grasp; writes log, figure and Meshcat recording."""
    from exodrake.cli.simulate import files_of
    from exodrake.core.files import write_folder
    from exodrake.data.formats import log_bytes
    from exodrake.simulation.scenario import Scenario

    with console.status("simulating (the first run compiles for half a minute)") as status:
        scenario = Scenario(GRASP)
        robot, log = scenario.run()
        contents = files_of(scenario, robot, log, GRASP, status.update)
        write_folder(folder, {"log.csv": log_bytes(log, folder / "log.csv"), **contents})
    angles = log.array("angle")
    reached = ", ".join(f"{j} {57.3 * a:.0f}°" for j, a in zip(robot.machine.axes.joints, angles.max(axis=0)))
    console.print(f"   {GRASP} for {log.duration:.0f} s: {reached}")


def hide(console: Console, out: Path, seed: int) -> None:
    """Makes one case with one injected effect by the reference simulator, and commits to its label."""
    from exodrake.reference.answers import write_committed
    from exodrake.reference.make import make_case
    from exodrake.reference.simulator import warm_up

    with console.status("the reference simulator runs"):
        warm_up()
        label = make_case(case_plan(seed), out)
        write_committed({CASE: label}, out / LABELS, out / COMMITMENT)
    digest = (out / COMMITMENT).read_text()[:16]
    console.print(f"   five logs in {out / CASE}, SHA-256 of the label {digest}…", soft_wrap=True, markup=False)


def case_plan(seed: int) -> Any:
    """The plan of a case with a single effect, drawn by the seed."""
    import numpy as np

    from exodrake.reference.cases import CasePlan
    from exodrake.reference.faults import LIBRARY

    identity = str(np.random.default_rng([seed, 0]).choice(list(LIBRARY)))
    return CasePlan(CASE, (seed, 1), "single", (identity,), False)


def diagnose(out: Path) -> Diagnosis:
    """Diagnoses the case, prints the summary and writes report, answer and robot."""
    from exodrake.cli.diagnose import contents_of, report_of, say_written, write_all
    from exodrake.core.progress import stages
    from exodrake.data.case import read_case
    from exodrake.diagnosis.pipeline import diagnose
    from exodrake.machines.robot_file import load_robot
    from exodrake.report.terminal import print_summary

    case, nominal = read_case(out / CASE), load_robot()
    with stages() as progress:
        found = diagnose(case, nominal, progress=progress)
    written = write_all(contents_of(found, out / "diagnosis.json", out / "robot.yaml"))
    written += write_all({out / "report.html": report_of(found, case, nominal)})
    print_summary(found)
    say_written(written)
    return found


def reveal(console: Console, out: Path, found: Diagnosis) -> None:
    """Reads the label, and prints whether the verdict was right."""
    from exodrake.reference.answers import read_committed
    from exodrake.reference.measures import accepted_ids, found_ids
    from exodrake.report.wording import listed

    label = read_committed(out / LABELS, out / COMMITMENT)[CASE]
    for truth in label["effects"]:
        channels = listed((*truth["wires"], *truth["joints"]))
        parameters = ", ".join(f"{name} {value:.3g}" for name, value in truth["parameters"].items())
        where = f" on {channels}" if channels else ""
        console.print(f"   it was [bold]{truth['id']}[/bold]{where}  ({parameters}, SI)")
        if not truth["exact"]:
            console.print("   Its law has another form there, so its parameters are other numbers.")
        right = bool(accepted_ids(truth) & found_ids(found.to_json()))
        verdict = f"the verdict was {found.verdict}"
        missed = f"[red]not named[/red]: {verdict}; among single effects it is {rank_of(truth['id'], found)}"
        console.print(f"   [green]found[/green]: {verdict}" if right else f"   {missed}")


def rank_of(identity: str, found: Diagnosis) -> str:
    """Rank of an effect among the fitted sets that it is alone in, in words."""
    names = [one.id for one in found.candidates if "+" not in one.id]
    return f"number {names.index(identity) + 1} of {len(names)}" if identity in names else "not listed"
