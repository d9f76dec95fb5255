"""Tunes and judges the controllers of a diagnosed set.

exodrake blind make --seed 5 --cases 40 --out cases
exodrake blind run cases
python -m studies.transfer cases --labels cases-labels.json --cases 40 --jobs 2 --markdown transfer.md
"""

from __future__ import annotations

import json
from pathlib import Path

import click
from rich.console import Console

from exodrake.cli.main import OneLineErrors
from exodrake.cli.options import AnyPath
from exodrake.core.errors import InputError
from exodrake.core.files import write_text
from exodrake.core.progress import show_count
from exodrake.reference.score import markdown as markdown_of
from exodrake.report.terminal import print_table
from studies.transfer.control_task import TUNERS
from studies.transfer.study import as_json, tables, transfer


@click.command(cls=OneLineErrors)
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
def command(
    folder: Path, labels: Path, cases: int | None, seed: int, tuner: str, jobs: int, json_file: Path | None,
    markdown: Path | None,
) -> None:  # fmt: skip
    """Tune controllers on the nominal, retuned and improved robots of FOLDER and run them on the withheld robots.

    FOLDER is a set that `blind run` diagnosed. The labels are read only after every controller is tuned.
    """
    if not labels.is_file():
        raise InputError(f"{labels}: no such file")
    with show_count("tuning", resume="nothing is kept") as count:
        found = transfer(folder, labels, cases, jobs, seed, TUNERS[tuner], count)
    console = Console()
    for title, headings, rows in tables(found):
        console.print(f"[bold]{title}[/bold]")
        print_table(console, headings, rows, wrapped=0)
    for name, reason in found.failed.items():
        click.echo(f"{name}: {reason}", err=True)
    if json_file:
        write_text(json_file, json.dumps(as_json(found), indent=1, allow_nan=False) + "\n")
    if markdown:
        write_text(markdown, markdown_of(tables(found)))
    if found.failed:
        raise SystemExit(1)


if __name__ == "__main__":
    command()
