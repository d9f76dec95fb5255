"""`exodrake blind`: withheld cases from a reference simulator, their diagnoses and scores; `demo`: one such case."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import exodrake as exo
from exodrake.cli import options
from exodrake.core.errors import InputError, nearest
from exodrake.core.progress import show_count, where_to_run

GRASP = "caging"
CASE, LABELS, COMMITMENT = "case", "label.json", "commitment.txt"  # folder and files of the demo

HIDDEN = """Another simulator, with other equations, other numbers within 3 % and one effect that the nominal robot
   lacks, writes five logs. The label is committed to by its SHA-256."""


@click.group()
def command() -> None:
    """Make, commit to and score cases from the reference simulator."""


@options.command(command.command, short_help="Write the logs of drawn robots, their labels committed to apart.")
@click.option("--seed", required=True, type=click.IntRange(min=0), help="Seed of everything in the set.")
@click.option("--cases", required=True, type=click.IntRange(min=1), help="How many of each mix.")
@click.option("--out", required=True, type=options.AnyPath(), help="Folder of the cases.")
@click.option("--labels", type=options.AnyPath(), help="Labels file [default: OUT-labels.json].")
@options.option(
    "--mix", "mixes", multiple=True, default=("standard",), metavar="NAME",
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
        places = {case: case for case in cases}
        failed = diagnose_all(places, jobs, cluster, count, redo, command=options.command_line())
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


@options.command()
@options.option("--seed", type=click.IntRange(min=0), default=1, help="Which robot, and which fault.")
@options.option("--out", type=options.OutputFolder(), default=Path("demo"), help="Folder.")
def run_demo(seed: int, out: Path) -> dict[str, Any]:
    """Simulate a grasp, inject a fault into an independent reference simulator, and find it from logs alone."""
    from exodrake.cli.diagnose import FILES, diagnose_case
    from exodrake.cli.simulate import make_files
    from exodrake.reference import answers, make, simulator
    from exodrake.simulation.scenario import Scenario

    if (out / CASE).exists() or (out / LABELS).exists():
        raise InputError(f"{out}: holds an earlier demo; name another folder with --out, or remove it")
    chapter(1, "A grasp of the nominal robot", "The model closes an index finger by three tendons.")
    with options.waiting("simulating (the first run compiles for half a minute)") as say:
        scenario = Scenario(GRASP)
        robot, log = scenario.run()
        options.write_together(out / "grasp", {"log.csv": log} | make_files(scenario, robot, log, GRASP, say))
    angles = log.array("angle")
    reached = ", ".join(f"{j} {57.3 * a:.0f}°" for j, a in zip(robot.machine.axes.joints, angles.max(axis=0)))
    click.echo(f"   {GRASP} for {log.duration:.0f} s: {reached}")
    chapter(2, "A robot with a hidden fault", HIDDEN)
    with options.waiting("the reference simulator runs"):
        simulator.warm_up()
        label = make.make_case(case_plan(seed), out)
        answers.write_committed({CASE: label}, out / LABELS, out / COMMITMENT)
    digest = (out / COMMITMENT).read_text()[:16]
    click.echo(f"   five logs in {out / CASE}, SHA-256 of the label {digest}…")
    chapter(3, "The diagnosis", "Only the logs and the nominal robot are known. This takes a minute or two.")
    answer, report, improved = (out / name for name in FILES)
    found = diagnose_case(str(out / CASE), "", answer, report, improved)
    chapter(4, "The label", "Now the label is read, and checked against its SHA-256 commitment.")
    truth, right = reveal(out, found)
    click.echo(f"\n{click.style('look at', bold=True)}  {out}/grasp/recording.html   the finger in 3D")
    click.echo(f"         {out}/report.html   the diagnosis")
    click.echo(f"         {out}/improved.yaml   the fitted robot, for exodrake simulate --robot")
    return {"truth": truth, "found": right, "answer": found}


def chapter(number: int, title: str, words: str) -> None:
    """Print the heading of a chapter, and what happens in it."""
    click.secho(f"\n{number}  {title}", bold=True)
    click.secho(f"   {words}", dim=True)


def case_plan(seed: int) -> Any:
    """The plan of a case with a single effect, drawn by the seed."""
    import numpy as np

    from exodrake.reference.cases import CasePlan
    from exodrake.reference.faults import LIBRARY

    identity = str(np.random.default_rng([seed, 0]).choice(list(LIBRARY)))
    return CasePlan(CASE, (seed, 1), "single", (identity,), False)


def reveal(out: Path, found: exo.Diagnosis) -> tuple[list[dict[str, Any]], bool]:
    """Read the label, and print whether the verdict was right; its effects, and whether each was found."""
    from exodrake.reference.answers import read_committed
    from exodrake.reference.score import accepted_ids, found_ids
    from exodrake.report.wording import join_words

    effects, right = read_committed(out / LABELS, out / COMMITMENT)[CASE]["effects"], True
    for truth in effects:
        channels = join_words((*truth["wires"], *truth["joints"]))
        parameters = ", ".join(f"{name} {value:.3g}" for name, value in truth["parameters"].items())
        where = f" on {channels}" if channels else ""
        click.echo(f"   it was {truth['id']}{where}  ({parameters}, SI)")
        if not truth["exact"]:
            click.echo("   Its law has another form there, so its parameters are other numbers.")
        if accepted_ids(truth) & found_ids(found.to_json()):
            click.echo(f"   {click.style('found', fg='green')}: the verdict was {found.verdict}")
            continue
        right = False
        alone = [one.id for one in found.candidates if "+" not in one.id]
        rank = f"number {alone.index(truth['id']) + 1} of {len(alone)}" if truth["id"] in alone else "not listed"
        missed = f"the verdict was {found.verdict}; among single effects it is {rank}"
        click.echo(f"   {click.style('not named', fg='red')}: {missed}")
    return effects, right
