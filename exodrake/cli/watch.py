"""`exodrake watch`: follows a log that still grows, and raises an alarm when the robot leaves its model."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from exodrake.cli.options import AnyPath, robot_option

if TYPE_CHECKING:
    from exodrake.monitor.watcher import Monitor

REDRAW = 4  # times a second


@click.command()
@click.argument("log", type=AnyPath(dir_okay=False))
@robot_option()
@click.option("--until-idle", type=click.FloatRange(min=0), default=None, metavar="TIME",
              help="End when no row has come for this time [s; never]; 0 reads a complete log to its end.")  # fmt: skip
def command(log: Path, robot: str, until_idle: float | None) -> None:
    """Follow LOG, a CSV file that a robot is writing, and show the gap between each of its segments and the model.

    The model runs beside the robot, frame by frame. Ctrl-C ends with a summary. The exit status is 1 if there was an
    alarm. For the cause: `exodrake diagnose LOG`; for an animation: `exodrake show LOG`.
    """
    from exodrake.machines.robot_file import load_robot
    from exodrake.monitor.display import summary
    from exodrake.monitor.watcher import Monitor

    click.echo("loading the model (the first run compiles for half a minute)", err=True)
    monitor = Monitor(load_robot(robot))
    if not log.exists():
        click.echo(f"waiting for {log}", err=True)
    with suppress(KeyboardInterrupt):
        (in_terminal if sys.stdout.isatty() else in_lines)(monitor, log, until_idle)
    click.echo("\n".join([*monitor.notes, *summary(monitor, log)]))
    if monitor.alarms:
        sys.exit(1)


def in_terminal(monitor: Monitor, log: Path, idle: float | None) -> None:
    """A display that is redrawn in place."""
    from rich.console import Console
    from rich.live import Live

    from exodrake.monitor.display import screen
    from exodrake.monitor.watcher import follow

    with Live(
        screen(monitor, log), console=Console(highlight=False), refresh_per_second=REDRAW, transient=True
    ) as live:
        for _ in follow(monitor, log, idle):
            live.update(screen(monitor, log))


def in_lines(monitor: Monitor, log: Path, idle: float | None) -> None:
    """A line for every 10 s of the log, and one for each alarm."""
    from exodrake.monitor.display import EVERY, line, sentence
    from exodrake.monitor.watcher import follow

    printed = 0
    for reading in follow(monitor, log, idle):
        if reading is not None and reading.second % EVERY == 0:
            click.echo(line(monitor, reading))
        for alarm in monitor.alarms[printed:]:
            click.echo(sentence(monitor, alarm, log))
        printed = len(monitor.alarms)
