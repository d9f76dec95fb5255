"""`exodrake calibrate`: error rates of a machine's diagnosis, from simulated robots."""

from __future__ import annotations

import shlex
from datetime import date
from pathlib import Path

import click

from exodrake.cli.options import AnyPath, robot_option
from exodrake.core.progress import counted, where_to_run


@click.command()
@robot_option()
@click.option("--case", "folder", default=None, metavar="CASE", help="Folder or log whose motion the robots follow.")
@click.option("--cases", default=60, show_default=True, type=click.IntRange(min=1), help="How many robots at most.")
@click.option("--minutes", default=9.0, show_default=True, type=click.FloatRange(min=0.0), help="Time for them.")
@click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0), help="Of everything that is drawn.")
@where_to_run
@click.option("--write", type=AnyPath(), metavar="FILE", help="calibration.yaml of the machine's folder.")
def command(
    robot: str, folder: str | None, cases: int, minutes: float, seed: int, jobs: int, cluster: str | None,
    write: Path | None,
) -> None:  # fmt: skip
    """Count how often the diagnosis of a machine errs, on simulated robots.

    The robots' parameters are drawn within their tolerances; two of three have an effect of the library. Without
    --case they follow the machine's own experiments. The same seed gives the same robots, whatever --jobs is; fewer
    where the time ends before.
    """
    from rich.console import Console

    from exodrake.cli.diagnose import check_target
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
