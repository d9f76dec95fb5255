"""`exodrake blind`: withheld cases from a reference simulator, their diagnoses and scores."""

import click

from exodrake.cli import options
from exodrake.core.errors import InputError, nearest
from exodrake.core.progress import show_count, where_to_run


@click.group()
def command() -> None:
    """Make, commit to and score cases from the reference simulator."""


@options.command(command.command, short_help="Write the logs of drawn robots, their labels committed to apart.")
@click.option("--seed", required=True, type=click.IntRange(min=0), help="Of everything in the set.")
@click.option("--cases", required=True, type=click.IntRange(min=1), help="How many of each mix.")
@click.option("--out", required=True, type=options.AnyPath(), help="Folder of the cases.")
@click.option("--labels", type=options.AnyPath(), help="Labels file [default: OUT-labels.json].")
@click.option(
    "--mix", "mixes", multiple=True, default=("standard",), show_default=True, metavar="NAME",
    help="standard, healthy, small (effects near the detection limit), half (logs half as long), no-mocap,"
    " no-load-cells, encoders-alone, same-block (two effects) or three (effects); several times for several mixes.",
)  # fmt: skip
@where_to_run
def make(seed, cases, out, labels, mixes, jobs, cluster) -> object:
    """Draw robots from the reference simulator and write their logs; the labels are committed to apart.

    The same seed makes the same set, whatever --jobs is. If it is interrupted, the same command goes on from there.
    """
    from exodrake.reference.cases import MIXES
    from exodrake.reference.make import make as make_set

    if unknown := [name for name in mixes if name not in MIXES]:
        hint = nearest(unknown[0], list(MIXES)) or f"; there are {', '.join(MIXES)}"
        raise InputError(f"no case mix {unknown[0]!r}{hint}")
    chosen = tuple(MIXES[name] for name in dict.fromkeys(mixes))
    with show_count("making") as count:
        path = make_set(out, seed, cases, labels, jobs, chosen, cluster, count)
    click.echo(f"cases in {out}: {cases * len(chosen)}; labels in {path}, committed in {out / 'seal.txt'}")
    return {"cases": cases * len(chosen), "labels": path, "commitment": out / "seal.txt"}


@options.command(command.command)
@click.argument("folder", type=options.AnyPath())
@where_to_run
@click.option("--redo", is_flag=True, help="Answer anew what another version or other code answered.")
def run(folder, jobs, cluster, redo) -> object:
    """Diagnose every case of FOLDER that has no diagnosis yet.

    Each answer is written as soon as it is there. If it is interrupted, the same command goes on from there; a case
    that fails leaves its reason in failed.json, and is tried again.
    """
    from exodrake.diagnosis.many import diagnose_all
    from exodrake.reference.answers import find_cases

    cases = find_cases(folder)
    with show_count("diagnosing") as count:
        typed = options.command_line()
        failed = diagnose_all({case: case for case in cases}, jobs, cluster, count, redo, command=typed)
    options.note_failures(failed)
    return {"cases": len(cases), "failed": failed}


@options.command(command.command, short_help="Score the diagnoses of FOLDER against the labels.")
@click.argument("folder", type=options.AnyPath())
@click.option("--labels", required=True, type=options.AnyPath(), help="Labels file of the set.")
@click.option("--against", type=options.AnyPath(), help="Folder of other answers to the same cases.")
@click.option("--markdown", type=options.OutputFile("score.md"), help="Write the score as Markdown.")
def score(folder, labels, against, markdown) -> object:
    """Check the commitment and score the diagnoses of FOLDER against the labels.

    --against compares them, case by case, with the answers that another method or configuration gave.
    """
    from exodrake.reference.score import Answers, markdown as as_markdown, score as score_set, tables

    result = score_set(folder, labels, against)
    for title, headings, rows in tables(result):
        if headings is Answers._fields:  # wrong answers in red
            rows = [row if row[2] else [f"[red]{cell}[/red]" for cell in row] for row in rows]
        else:
            headings = [headings[0], *(f">{heading}" for heading in headings[1:])]
        click.echo(f"\n{title}")
        options.print_table(headings, rows)
    if markdown:
        options.write_files({markdown: as_markdown(tables(result))})
    return result
