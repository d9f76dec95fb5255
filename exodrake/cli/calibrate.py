"""`exodrake calibrate`: the numbers of a machine's tests, and their error rates, from simulated robots."""

from __future__ import annotations

import shlex
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from exodrake.cli.options import AnyPath, robot_option
from exodrake.core.progress import counted, where_to_run

if TYPE_CHECKING:
    from exodrake.diagnosis.calibration import Calibration


@click.command()
@robot_option()
@click.option("--case", "folder", default=None, metavar="CASE", help="Folder or log whose motion the robots follow.")
@click.option("--cases", default=100, show_default=True, type=click.IntRange(min=1), help="How many robots.")
@click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0), help="Of everything that is drawn.")
@click.option("--keep-numbers", is_flag=True, help="State the error rates of the numbers in use, and keep those.")
@where_to_run
@click.option("--write", type=AnyPath(), metavar="FILE", help="calibration.yaml of the machine's folder.")
def command(
    robot: str,
    folder: str | None,
    cases: int,
    seed: int,
    keep_numbers: bool,
    jobs: int,
    cluster: str | None,
    write: Path | None,
) -> None:
    """Calibrate the tests of a machine on simulated robots, and count how often they err.

    The robots' parameters are drawn within their tolerances; two of three have an effect of the library. Without
    --case they follow the machine's own experiments. The same seed gives the same numbers, whatever --jobs is.
    """
    from exodrake.cli.diagnose import check_target
    from exodrake.core.files import write_text
    from exodrake.data.case import read_case
    from exodrake.diagnosis.calibrate import calibrate, numbers_of, rates_of
    from exodrake.diagnosis.calibration import NUMBERS, calibration_of, calibration_text
    from exodrake.diagnosis.problem import required_of
    from exodrake.machines.robot_file import load_robot

    check_target(write)
    machine = load_robot(robot).machine
    case = read_case(folder, required_of(machine), machine.frame) if folder else None
    with counted("calibrating", "nothing is kept") as count:
        records, failed = calibrate(robot, cases, seed, case, jobs, cluster, count)
    report_failures(failed, cases)
    found, rests_on = numbers_of(records, source_of(robot, folder, cases, seed, keep_numbers))
    rates = rates_of(records)
    print_calibration(found, rests_on, rates)
    if keep_numbers:
        measured = ", ".join(f"{name} {getattr(found, name):.3g}" for name in NUMBERS)
        source = f"{found.source}, gave the rates and found {measured}; the numbers in use were kept"
        found, rests_on = replace(calibration_of(machine), source=source), {}
    if write:
        write_text(write, calibration_text(found, rests_on, rates))
        click.echo(f"wrote {write}")


def report_failures(failed: dict[int, str], cases: int) -> None:
    """Says how many robots failed, and why the first did; InputError if all did."""
    from exodrake.core.errors import InputError

    if failed:
        click.echo(f"{len(failed)} of {cases} robots failed; robot {min(failed)}: {failed[min(failed)]}", err=True)
    if len(failed) == cases:
        raise InputError("no robot could be diagnosed")


def source_of(robot: str, folder: str | None, cases: int, seed: int, keep_numbers: bool) -> str:
    """The command and today's date, without the path of a folder."""
    motion, kept = ["--case", Path(folder).name] if folder else [], ["--keep-numbers"] if keep_numbers else []
    words = ["exodrake", "calibrate", "--robot", Path(robot).name, *motion, "--cases", str(cases), "--seed", str(seed)]
    return f"{shlex.join([*words, *kept])}, {date.today()}"


def print_calibration(found: Calibration, rests_on: dict[str, int], rates: dict[str, dict[str, Any]]) -> None:
    """Prints the numbers beside the default ones, and the error rates with their intervals."""
    from rich.console import Console

    from exodrake.diagnosis.calibration import UNCALIBRATED
    from exodrake.diagnosis.level_table import MEANINGS
    from exodrake.report import number_format as n
    from exodrake.report.terminal import table

    values = {name: (getattr(found, name), getattr(UNCALIBRATED, name)) for name in MEANINGS}
    numbers = [
        (name, MEANINGS[name], f"{value:.3g}", f"{old:.3g}", str(rests_on[name]))
        for name, (value, old) in values.items()
    ]
    console = Console(highlight=False)
    console.print(table(("number", "meaning", ">value", ">default", ">robots"), numbers, wrapped=1))
    console.print()
    rows = [
        (name, f"{r['k']} of {r['n']}", n.percent(r["k"] / r["n"]), f"{r['low']:.0%} .. {r['high']:.0%}")
        for name, r in rates.items()
        if r["n"]
    ]
    console.print(table(("rate", ">robots", ">share", ">95 % interval"), rows))
