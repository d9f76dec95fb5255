"""`exodrake blind`: withheld cases from a reference simulator, diagnoses, and what controllers gain from them."""

from pathlib import Path

import click

from exodrake.cli.options import AnyPath
from exodrake.core.progress import counted, where_to_run


@click.group()
def command() -> None:
    """Make, commit to and score cases from the reference simulator."""


@command.command(short_help="Write the logs of drawn robots, their labels committed to apart.")
@click.option("--seed", required=True, type=click.IntRange(min=0), help="Of everything in the set.")
@click.option("--cases", required=True, type=click.IntRange(min=1), help="How many of each mix.")
@click.option("--out", required=True, type=AnyPath(), help="Folder of the cases.")
@click.option("--labels", type=AnyPath(), default=None, help="Labels file [default: OUT-labels.json].")
@click.option(
    "--mix", "mixes", multiple=True, default=("standard",), show_default=True, metavar="NAME",
    help="standard, healthy, small (effects near the detection limit), half (logs half as long), no-mocap,"
    " no-load-cells, encoders-alone, same-block (two effects) or three (effects); several times for several mixes.",
)  # fmt: skip
@where_to_run
def make(
    seed: int, cases: int, out: Path, labels: Path | None, mixes: tuple[str, ...], jobs: int, cluster: str | None
) -> None:
    """Draw robots from the reference simulator and write their logs; the labels are committed to apart.

    The same seed makes the same set, whatever --jobs is. If it is interrupted, the same command goes on from there.
    """
    from exodrake.blind.case_mix import named_mixes
    from exodrake.blind.catalogue import without_entry
    from exodrake.blind.make import make as make_set
    from exodrake.machines.robot_file import load_robot

    if lacking := without_entry(effect.id for effect in load_robot().machine.effects):
        click.echo(
            f"effects that no case has, since the reference simulator lacks them: {', '.join(lacking)}", err=True
        )
    chosen = named_mixes(mixes)
    with counted("making") as count:
        path = make_set(out, seed, cases, labels, jobs, chosen, cluster, count)
    click.echo(f"cases in {out}: {cases * len(chosen)}; labels in {path}, committed in {out / 'seal.txt'}")


@command.command()
@click.argument("folder", type=AnyPath())
@where_to_run
@click.option("--redo", is_flag=True, help="Answer anew what another version or other code answered.")
def run(folder: Path, jobs: int, cluster: str | None, redo: bool) -> None:
    """Diagnose every case of FOLDER that has no diagnosis yet.

    Each answer is written as soon as it is there. If it is interrupted, the same command goes on from there; a case
    that fails leaves its reason in failed.json, and is tried again.
    """
    from exodrake.blind.run import run as run_set

    with counted("diagnosing") as count:
        failed = run_set(folder, jobs, cluster, count, redo)
    for name, reason in failed.items():
        click.echo(f"{name}: {reason}", err=True)
    if failed:
        raise SystemExit(1)


@command.command(short_help="Score the diagnoses of FOLDER against the labels.")
@click.argument("folder", type=AnyPath())
@click.option("--labels", required=True, type=AnyPath(), help="Labels file of the set.")
@click.option("--against", type=AnyPath(), default=None, help="Folder of other answers to the same cases.")
@click.option("--json", "json_file", type=AnyPath(), default=None, help="Write the score as JSON.")
@click.option("--markdown", type=AnyPath(), default=None, help="Write the score as Markdown.")
def score(folder: Path, labels: Path, against: Path | None, json_file: Path | None, markdown: Path | None) -> None:
    """Check the commitment and score the diagnoses of FOLDER against the labels.

    --against compares them, case by case, with the answers that another method or configuration gave.
    """
    import json

    from rich.console import Console

    from exodrake.blind.score import score as score_set
    from exodrake.blind.score_table import as_json, as_markdown, as_tables
    from exodrake.core.files import write_text

    result = score_set(folder, labels, against)
    console = Console()
    for table in as_tables(result):
        console.print(table)
    if json_file:
        write_text(json_file, json.dumps(as_json(result), indent=1) + "\n")
    if markdown:
        write_text(markdown, as_markdown(result))


@command.command(short_help="What a controller gains from a diagnosis.")
@click.argument("folder", type=AnyPath())
@click.option("--labels", required=True, type=AnyPath(), help="Labels file of the set.")
@click.option("--cases", type=click.IntRange(min=1), default=None, help="How many, from the first [all].")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the motions and all noise.")
@click.option(
    "--tuner", type=click.Choice(["cost", "requirements"]), default="cost", show_default=True,
    help="Least cost of a task, or as `exodrake tune` does.",
)  # fmt: skip
@click.option("--jobs", default=1, show_default=True, type=click.IntRange(min=-1), help="Processes; -1 for one a core.")
@click.option("--json", "json_file", type=AnyPath(), default=None, help="Write all numbers as JSON.")
@click.option("--markdown", type=AnyPath(), default=None, help="Write the tables as Markdown.")
def transfer(
    folder: Path, labels: Path, cases: int | None, seed: int, tuner: str, jobs: int, json_file: Path | None,
    markdown: Path | None,
) -> None:  # fmt: skip
    """Tune controllers on the nominal, retuned and improved robots of FOLDER and run them on the withheld robots.

    FOLDER is a set that `blind run` diagnosed. The labels are read only after every controller is tuned.
    """
    import json

    from rich.console import Console

    from exodrake.blind.control_task import TUNERS
    from exodrake.blind.score_table import markdown as markdown_of
    from exodrake.blind.transfer import transfer as transfer_set
    from exodrake.blind.transfer_table import as_json, tables
    from exodrake.core.errors import InputError
    from exodrake.core.files import write_text
    from exodrake.report.terminal import table

    if not labels.is_file():
        raise InputError(f"{labels}: no such file")
    with counted("tuning", resume="nothing is kept") as count:
        found = transfer_set(folder, labels, cases, jobs, seed, TUNERS[tuner], count)
    console = Console()
    for title, headings, rows in tables(found):
        console.print(f"[bold]{title}[/bold]")
        console.print(table(headings, rows, wrapped=0))
    for name, reason in found.failed.items():
        click.echo(f"{name}: {reason}", err=True)
    if json_file:
        write_text(json_file, json.dumps(as_json(found), indent=1, allow_nan=False) + "\n")
    if markdown:
        write_text(markdown, markdown_of(tables(found)))
    if found.failed:
        raise SystemExit(1)
