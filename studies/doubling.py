"""Whether answers survive that every log is there twice: a decision that is free of scale does not count rows.

    exodrake blind make --seed 7 --cases 20 --out cases
    exodrake blind run cases
    python -m studies.doubling cases --keep kept --out doubling.md

Two copies of a log hold nothing new, but an answer that counts rows grows more certain of itself.
What is measured is kept case by case, so the command can be repeated.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from exodrake.cli.main import OneLineErrors
from exodrake.core.errors import markdown_table
from exodrake.core.files import write_text
from exodrake.data.case import Case, read_case
from exodrake.diagnosis.pipeline import diagnose
from exodrake.diagnosis.problem import list_required
from exodrake.machines.robot_file import load_robot
from exodrake.reference.score import list_classes
from studies.page_text import keep as keep_answer, share

COPY = "again-"  # before the file's name


def doubled(case: Case) -> Case:
    """The case with a copy of each fitted log, not marked as a repeat; copies of repeats repeat copies."""
    copies = [
        replace(item, file=COPY + item.file, repeats=item.repeats and COPY + item.repeats) for item in case.fit_logs
    ]
    return replace(case, logs=(*case.logs, *copies))


def said(answer: dict[str, Any]) -> str:
    """Verdict and causes of an answer in one line, each with its rivals."""
    names = [" or ".join([ids[0], *sorted(ids[1:])]) for ids in list_classes(answer)]
    return " ".join([answer["verdict"], " + ".join(sorted(names))]).strip()


def page(rows: dict[str, tuple[str, str]], command: str) -> str:
    """The page, of each case's answers once and twice."""
    same = sum(once == twice for once, twice in rows.values())
    words = sum(once.split()[0] == twice.split()[0] for once, twice in rows.values())
    cells = [(name, once, "the same" if once == twice else twice) for name, (once, twice) in rows.items()]
    count = f"The same answer: {share(same, len(rows))}; the same verdict: {words}."
    table = markdown_table(("case", "once", "twice"), cells)
    return "\n\n".join(["# Every log twice", TEXT.format(command=command), count, table]) + "\n"


TEXT = """Answers to cases of the reference simulator, and to the same cases with a copy of every fitted log. The same
answer: verdict, and causes with their rivals.

    {command}"""


@click.command(cls=OneLineErrors)
@click.argument("folder", type=click.Path(exists=True, path_type=Path))
@click.option("--cases", default=20, show_default=True, type=click.IntRange(min=1), help="Cases, from the first on.")
@click.option("--keep", required=True, type=click.Path(path_type=Path), help="Folder of what is measured, by case.")
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Write the page.")
def command(folder: Path, cases: int, keep: Path, out: Path | None) -> None:
    """Diagnose cases of FOLDER, which holds their answers, with every log twice."""
    keep.mkdir(parents=True, exist_ok=True)
    robot, rows = load_robot(), {}
    read = partial(read_case, required=list_required(robot.machine), period=robot.machine.frame)
    for answered in sorted(folder.glob("*/diagnosis.json"))[:cases]:
        name, place = answered.parent.name, keep / f"{folder.name}-{answered.parent.name}.json"
        twice = keep_answer(place, lambda case=answered.parent: diagnose(doubled(read(case)), robot).to_json())
        rows[name] = (said(json.loads(answered.read_text())), said(twice))
        click.echo(f"{name}: {' | '.join(rows[name])}")
    if out:
        words = f"python -m studies.doubling {folder.name} --cases {cases} --keep kept --out {out}"
        write_text(out, page(rows, words))


if __name__ == "__main__":
    command()
