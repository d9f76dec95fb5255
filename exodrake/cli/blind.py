"""`exodrake blind`: withheld cases from a reference simulator, their diagnoses and scores."""

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
    from exodrake.machines.robot_file import load_robot
    from exodrake.reference.cases import named_mixes
    from exodrake.reference.faults import without_entry
    from exodrake.reference.make import make as make_set

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
    from exodrake.reference.answers import run as run_set

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

    from exodrake.core.files import write_text
    from exodrake.reference.score import as_json, as_markdown, as_tables, score as score_set

    result = score_set(folder, labels, against)
    console = Console()
    for table in as_tables(result):
        console.print(table)
    if json_file:
        write_text(json_file, json.dumps(as_json(result), indent=1) + "\n")
    if markdown:
        write_text(markdown, as_markdown(result))
