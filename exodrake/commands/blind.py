"""`exodrake blind`: make, run and score withheld cases from a second, independent simulator."""

from pathlib import Path

import click


def _bar(title: str):
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    return Progress(*columns, transient=False)


@click.group()
def command() -> None:
    """Make, seal and score cases from a second, independent simulator."""


@command.command(short_help="Write the logs of drawn robots, their labels sealed apart.")
@click.option("--seed", required=True, type=click.IntRange(min=0), help="Of everything in the set.")
@click.option("--cases", required=True, type=click.IntRange(min=1), help="How many.")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder of the cases.")
@click.option("--labels", type=click.Path(path_type=Path), default=None, help="Labels file [default: OUT-labels.json].")
@click.option("--jobs", default=1, show_default=True, help="Processes; -1 for one a core.")
def make(seed: int, cases: int, out: Path, labels: Path | None, jobs: int) -> None:
    """Draw robots from the second reality and write their logs; the labels are sealed apart."""
    from exodrake.blind.make import make as make_set

    with _bar("making") as bar:
        task = bar.add_task("", total=cases)
        path = make_set(out, seed, cases, labels, jobs, progress=lambda done: bar.update(task, completed=done))
    click.echo(f"{cases} cases in {out}; labels in {path}, sealed in {out / 'seal.txt'}")


@command.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--jobs", default=1, show_default=True, help="Processes; -1 for one a core.")
@click.option("--cluster", default=None, help="Address of a Dask scheduler to run on.")
def run(folder: Path, jobs: int, cluster: str | None) -> None:
    """Diagnose every case of FOLDER that has no diagnosis yet."""
    from exodrake.blind.run import run as run_set

    with _bar("diagnosing") as bar:
        task = bar.add_task("")

        def progress(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        failed = run_set(folder, jobs, cluster, progress)
    for name, reason in failed.items():
        click.echo(f"{name}: {reason}", err=True)
    if failed:
        raise SystemExit(1)


@command.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--labels", required=True, type=click.Path(path_type=Path), help="Labels file of the set.")
@click.option("--json", "json_file", type=click.Path(path_type=Path), default=None, help="Write the score as JSON.")
@click.option("--markdown", type=click.Path(path_type=Path), default=None, help="Write the score as Markdown.")
def score(folder: Path, labels: Path, json_file: Path | None, markdown: Path | None) -> None:
    """Check the seal and hold the diagnoses of FOLDER against the labels."""
    import json

    from rich.console import Console

    from exodrake.blind.score import score as score_set
    from exodrake.blind.score_table import as_json, as_markdown, as_table, confusion_table
    from exodrake.files import write_text

    result = score_set(folder, labels)
    console = Console()
    console.print(as_table(result))
    console.print(confusion_table(result))
    if json_file:
        write_text(json_file, json.dumps(as_json(result), indent=1) + "\n")
    if markdown:
        write_text(markdown, as_markdown(result))
