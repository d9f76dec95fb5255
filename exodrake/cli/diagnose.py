"""`exodrake diagnose`, of a case or of many side by side; `fleet`, of many answers; `calibrate`, its error rates."""

from __future__ import annotations

import os
import shlex
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from exodrake.cli.options import AnyPath, command_line, robot_option, tried_of
from exodrake.core.errors import InputError
from exodrake.core.progress import counted, where_to_run

if TYPE_CHECKING:
    from exodrake.core.robot import Robot
    from exodrake.data.case import Case
    from exodrake.diagnosis.result import Diagnosis


FOLDER = {"type": AnyPath(), "default": None}
FILE = {"type": AnyPath(), "default": None, "metavar": "FILE"}


@click.command()
@click.argument("cases", nargs=-1, required=True, metavar="CASE...")
@click.option("--json", "json_file", **FILE, help="Write the answer as JSON, in SI.")
@click.option("--report", **FILE, help="Write a report as one HTML file.")
@click.option("--out-robot", **FILE, help="Write the improved robot, for `exodrake simulate --robot`.")
@robot_option(default="")
@click.option("--effects", "only", default="", metavar="ID,...", help="Try these effects only.")
@click.option("--without", default="", metavar="ID,...", help="Do not try these effects.")
@click.option("--discover/--no-discover", default=None, help="Look for a law that the library lacks [for UNKNOWN].")
@click.option("--out-law", metavar="FOLDER", **FOLDER, help="Write a law that was found, as a plugin with its robot.")
@click.option("--profile", is_flag=True, help="Say how much processor time and simulated time each stage took.")
@click.option("--jobs", type=click.IntRange(min=1), default=None, help="Processor cores to use [all].")
@click.option("--out", type=AnyPath(), metavar="FOLDER", help="Of several cases: a folder for each.")
@click.option("--cluster", metavar="ADDRESS", help="Of several cases: Dask scheduler to run on.")
@click.option("--allow-outside", is_flag=True, help="Read logs that lie outside the folder of their case, too.")
@click.option("--redo", is_flag=True, help="Of several cases: answer anew what another configuration answered.")
def command(
    cases: tuple[str, ...], json_file: Path | None, report: Path | None, out_robot: Path | None, robot: str,
    only: str, without: str, jobs: int | None, out: Path | None, cluster: str | None, redo: bool,
    allow_outside: bool, profile: bool, discover: bool | None, out_law: Path | None,
) -> None:  # fmt: skip
    """Say where the logs of CASE differ from the robot's model, which effect causes it and how far it shrinks.

    CASE is a folder of logs (see its case.yaml) or one log file. Several are diagnosed side by side, one core each,
    into --out: FOLDER/CASE/diagnosis.json as soon as it is there; the same command goes on where it was interrupted.
    """
    if len(cases) != 1 or out is not None:
        refuse_files(json_file, report, out_robot, out_law)
        if discover:
            raise click.UsageError("--discover is for one case")
        tried = tried_of(robot, only, without)
        return diagnose_many(cases, out, robot, jobs or -1, cluster, redo, tried, allow_outside)
    if cluster or redo:
        raise click.UsageError("--cluster and --redo are for several cases, with --out")
    law = (True if out_law is not None and discover is None else discover, out_law)
    diagnose_case(cases[0], json_file, report, out_robot, robot, jobs, (only, without), allow_outside, profile, law)


def refuse_files(*paths: Path | None) -> None:
    """UsageError for files that hold one answer."""
    for name, path in zip(("--json", "--report", "--out-robot", "--out-law"), paths, strict=True):
        if path is not None:
            raise click.UsageError(f"{name} is for one case; several are written to --out")


def diagnose_case(
    case: str, json_file: Path | None, report: Path | None, out_robot: Path | None, robot: str, jobs: int | None,
    choice: tuple[str, str] = ("", ""), allow_outside: bool = False, profile: bool = False,
    law: tuple[bool | None, Path | None] = (None, None),
) -> None:  # fmt: skip
    """One case: summary and files; law: whether to look for a missing one (for UNKNOWN if None), and its folder."""
    from exodrake.core.progress import Stage, stages, timed
    from exodrake.data.case import read_case
    from exodrake.diagnosis.problem import required_of
    from exodrake.machines.robot_file import load_robot
    from exodrake.report.terminal import print_profile, print_summary

    for path in (json_file, report, out_robot):
        check_target(path)
    limit_cores(jobs)
    nominal = load_robot(robot) if robot else load_robot()
    tried = tried_of(robot, *choice)
    read = read_case(case, required_of(nominal.machine), nominal.machine.frame, allow_outside)
    known: list[Diagnosis] = []
    written: dict[Path, None] = {}
    spent: dict[Stage, float] = {}

    def keep(found: Diagnosis) -> None:
        """Writes the answer, and the report last: an error in it loses nothing."""
        known[:] = [with_command(found)]
        written.update(dict.fromkeys(write_all(contents_of(known[0], json_file, out_robot))))
        if report is not None:
            written.update(dict.fromkeys(write_all({report: report_of(known[0], read, nominal)})))

    try:
        with stages() as shown, timed(shown) as (progress, spent):
            from exodrake.diagnosis.pipeline import diagnose
            from exodrake.diagnosis.result import UNKNOWN

            discovers, folder = law
            wanted = (lambda verdict: verdict == UNKNOWN) if discovers is None else (lambda _: bool(discovers))
            found = diagnose(read, nominal, progress, tried, wanted, answered=keep)
        keep(found)
        written.update(dict.fromkeys(law_files(found, folder)))
    finally:  # also of a search for a law, or a report, that is interrupted or fails
        if known:
            print_summary(known[0])
            if profile:
                print_profile(known[0], spent)
            say_written(list(written))


def law_files(found: Diagnosis, folder: Path | None) -> list[Path]:
    """Writes a law that was found into a plugin folder; nothing without a folder or a law."""
    law = found.missing_law
    if folder is None or law is None or law.robot is None:
        return []
    from exodrake.diagnosis.discovery.law_code import write_law

    return write_law(folder, law.id, law.text, law.robot, found.case)


def with_command(found: Diagnosis) -> Diagnosis:
    """The answer with its command."""
    from dataclasses import replace

    made = found.provenance
    return found if made is None else replace(found, provenance=replace(made, command=command_line()))


def check_target(path: Path | None) -> None:
    """InputError before a minute's work if a file could not be written in the end."""
    from exodrake.core.errors import InputError

    if path is None:
        return
    if path.is_dir():
        raise InputError(f"{path}: a folder, wanted a file")
    if not path.parent.is_dir():
        raise InputError(f"{path}: no folder {str(path.parent)!r} to write it into")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{path}: its folder takes no files")


def limit_cores(jobs: int | None) -> None:
    """Holds compiled loops and linear algebra to some cores; as many as there are for None."""
    if jobs is None:
        return
    import numba

    from exodrake.core.threads import thread_limit

    numba.set_num_threads(min(jobs, numba.config.NUMBA_NUM_THREADS))  # pyright: ignore
    thread_limit(count=jobs)


def report_of(found: Diagnosis, case: Case, nominal: Robot) -> str:
    """The report, made after the answer is written: an error in it loses no answer."""
    from exodrake.diagnosis.problem import make_problem
    from exodrake.report.diagnosis_html import report_html

    return report_html(found, found.problem or make_problem(case, nominal))


def contents_of(found: Diagnosis, json_file: Path | None, out_robot: Path | None) -> dict[Path, str]:
    """Texts of the answer's files, made before any is written."""
    import json

    contents = {}
    if json_file is not None:
        contents[json_file] = json.dumps(found.to_json(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    if out_robot is not None:
        contents[out_robot] = found.robot_file(found.robot)
    return contents


def write_all(contents: dict[Path, str]) -> list[Path]:
    """Writes the files, each whole or not at all."""
    from exodrake.core.files import write_text

    for path, text in contents.items():
        write_text(path, text)
    return list(contents)


def say_written(files: list[Path]) -> None:
    """Prints where the files are."""
    for path in files:
        click.echo(f"written {path}")


def diagnose_many(
    cases: tuple[str, ...], out: Path | None, robot: str, jobs: int, cluster: str | None, redo: bool,
    tried: frozenset[str] | None, allow_outside: bool = False,
) -> None:  # fmt: skip
    """Diagnose cases in parallel. Exit status 1 if some fail; UsageError or InputError before the work starts."""
    from rich.console import Console

    from exodrake.core.progress import counted
    from exodrake.diagnosis.many import diagnose_all, stored

    if out is None:
        raise click.UsageError("several cases need --out FOLDER")
    places = places_of(cases, out)
    with counted("diagnosing") as count:
        failed = diagnose_all(places, jobs, cluster, count, redo, robot, tried, allow_outside)
    Console().print(verdicts({place.name: stored(place) for place in places.values()}))
    for name, reason in failed.items():
        click.echo(f"{name}: {reason}", err=True)
    if failed:
        raise SystemExit(1)


def places_of(cases: tuple[str, ...], out: Path) -> dict[Path, Path]:
    """Map each case to the folder for its answer. InputError for a missing case, and for two of one name."""
    from exodrake.data.formats import stem

    places: dict[Path, Path] = {}
    for name in cases:
        case = Path(name)
        if not case.exists():
            raise InputError(f"{name}: no such folder")
        place = out / (case.resolve().name if case.is_dir() else stem(name))
        namesake = next((other for other, taken in places.items() if taken == place), None)
        if namesake is not None:
            raise InputError(f"{name}: has the same name as {namesake}, and so would its answer")
        places[case] = place
    return places


def verdicts(answers: dict[str, dict[str, Any] | None]) -> Any:
    """Tabulate case, verdict, causes with their share of the gap, and closure."""
    from rich.markup import escape
    from rich.table import Table

    from exodrake.diagnosis.result import CAUSE
    from exodrake.report.wording import closure

    table = Table("case", "verdict", "causes", "closure")
    for name, answer in answers.items():
        name = escape(name)
        if answer is None:
            table.add_row(name, "[red]failed[/red]", "", "")
            continue
        effects = ", ".join(map(cause, (e for e in answer["effects"] if e.get("role", CAUSE) == CAUSE)))
        value = answer["closure"]["overall"].get("value") if effects else None
        said = "" if value is None else closure(value)
        refuted = " (not confirmed)" if answer.get("confirmed") is False else ""
        table.add_row(name, answer["verdict"] + refuted, effects, said)
    return table


def cause(effect: dict[str, Any]) -> str:
    """A cause with its rivals and its share of the gap, which answers of older versions lack."""
    from exodrake.report.wording import share

    names = " or ".join([effect["id"], *(rival["id"] for rival in effect.get("rivals") or ())])
    value = (effect.get("share") or {}).get("value")
    return names if value is None else f"{names} {share(value)}"


LISTED, CAUSE = 4, 2  # columns of the report's table that the terminal shows, and the one that is wrapped


@click.command()
@click.argument("source", type=AnyPath(), metavar="FOLDER_OR_TABLE")
@click.option("--out", **FILE, help="Write the report: which robots, which causes, since when.")
@click.option("--table", **FILE, help="Write the table, a row each case, as Parquet.")
def summarise_fleet(source: Path, out: Path | None, table: Path | None) -> None:
    """Say of many diagnosed cases which robots have which causes, and since when.

    FOLDER_OR_TABLE is the folder that `exodrake diagnose CASE... --out FOLDER` wrote, or a table made from it by
    --table. Cases belong to the robot that `serial:` names in their case.yaml, and are ordered by `date:`.
    """
    from rich.console import Console
    from rich.markup import escape

    from exodrake.core.files import write_bytes, write_text
    from exodrake.diagnosis.fleet import read_answers, read_table, table_bytes
    from exodrake.report.fleet import find_reports, fleet_html, members, robot_table
    from exodrake.report.terminal import table as table_of

    for path in (out, table):
        check_target(path)
    rows = read_answers(source) if source.is_dir() else read_table(source)
    if table is not None:
        write_bytes(table, table_bytes(rows))
    if out is not None:
        links = find_reports(source, out) if source.is_dir() else {}
        write_text(out, fleet_html(rows, source.resolve().name, links))
    shown = robot_table(members(rows))
    titles, cells = (
        shown.header[:LISTED],
        [[escape(cell.replace("`", "")) for cell in row[:LISTED]] for row in shown.rows],
    )
    Console(highlight=False).print(table_of(titles, cells, wrapped=CAUSE))
    for path in (table, out):
        if path is not None:
            click.echo(f"written {path}")


@click.command()
@robot_option()
@click.option("--case", "folder", default=None, metavar="CASE", help="Folder or log whose motion the robots follow.")
@click.option("--cases", default=60, show_default=True, type=click.IntRange(min=1), help="How many robots at most.")
@click.option("--minutes", default=9.0, show_default=True, type=click.FloatRange(min=0.0), help="Time for them.")
@click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0), help="Of everything that is drawn.")
@where_to_run
@click.option("--write", type=AnyPath(), metavar="FILE", help="calibration.yaml of the machine's folder.")
def count_errors(
    robot: str, folder: str | None, cases: int, minutes: float, seed: int, jobs: int, cluster: str | None,
    write: Path | None,
) -> None:  # fmt: skip
    """Count how often the diagnosis of a machine errs, on simulated robots.

    The robots' parameters are drawn within their tolerances; two of three have an effect of the library. Without
    --case they follow the machine's own experiments. The same seed gives the same robots, whatever --jobs is; fewer
    where the time ends before.
    """
    from rich.console import Console

    from exodrake.core.errors import InputError
    from exodrake.core.files import write_text
    from exodrake.core.provenance import configuration
    from exodrake.data.case import read_case
    from exodrake.diagnosis.calibrate import calibrate, rates_of
    from exodrake.diagnosis.calibration import RATES, Calibration, calibration_text, rate_of
    from exodrake.diagnosis.problem import required_of
    from exodrake.machines.robot_file import load_robot
    from exodrake.report import wording as w
    from exodrake.report.terminal import table

    check_target(write)
    machine = load_robot(robot).machine
    case = read_case(folder, required_of(machine), machine.frame) if folder else None
    with counted("calibrating", "nothing is kept") as count:
        records, failed = calibrate(robot, cases, seed, case, jobs, cluster, count, 60.0 * minutes)
    if failed:
        first = min(failed)
        click.echo(f"{len(failed)} robots failed; robot {first}: {failed[first]}", err=True)
    if not records:
        raise InputError("no robot could be diagnosed")
    counted_robots = len(records) + len(failed)
    if counted_robots < cases:
        click.echo(f"{counted_robots} of {cases} robots in {minutes:g} minutes", err=True)
    motion = ["--case", Path(folder).name] if folder else []
    words = ["exodrake", "calibrate", "--robot", Path(robot).name, *motion, "--cases", str(counted_robots)]
    source = f"{shlex.join([*words, '--seed', str(seed)])}, {date.today()}"
    found = Calibration(source, configuration()["code"], rates_of(records))
    rows = [
        (
            name,
            RATES[name],
            f"{k} of {total}",
            w.percent(k / total),
            "{low:.0%} .. {high:.0%}".format(**rate_of(k, total)),
        )
        for name, (k, total) in (found.rates or {}).items()
        if total
    ]
    Console(highlight=False).print(table(("rate", "meaning", ">count", ">share", ">95 % interval"), rows, wrapped=1))
    if write:
        write_text(write, calibration_text(found))
        click.echo(f"wrote {write}")
