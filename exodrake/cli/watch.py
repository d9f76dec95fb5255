"""`exodrake watch` follows a growing log and raises an alarm when the robot leaves its model; `alarm-limits`."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from exodrake.cli.options import AnyPath, robot_option
from exodrake.core.progress import where_to_run

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


@click.command()
@robot_option()
@click.option("--seed", default=21, show_default=True, type=click.IntRange(min=0), help="Of everything that is drawn.")
@click.option("--robots", default=100, show_default=True, type=click.IntRange(min=2), help="Simulated healthy robots.")
@click.option(
    "--minutes", default=20.0, show_default=True, type=click.FloatRange(min=0.5, max=1440), help="Work of each robot."
)
@click.option(
    "--write", type=AnyPath(), default=None, metavar="FILE",
    help="alarm_limits.yaml in the machine's folder, where `watch` finds it.",
)  # fmt: skip
@where_to_run
def find_alarm_limits(
    robot: str, seed: int, robots: int, minutes: float, write: Path | None, jobs: int, cluster: str | None
) -> None:
    """Find gaps that healthy robots stay below, from simulated ones at work whose parameters lie within tolerance."""
    import numpy as np

    from exodrake.cli.options import check_target
    from exodrake.core.files import write_text
    from exodrake.machines.robot_file import load_robot
    from exodrake.monitor.alarm import MINUTE, limits_of, limits_text, peaks_of, share_at_most
    from exodrake.monitor.gap import noise_std
    from exodrake.monitor.online_replay import channels

    check_target(write)
    nominal = load_robot(robot)
    peaks = peaks_of(robot, noise_std(nominal), seed, robots, minutes * MINUTE, jobs=jobs, cluster=cluster)
    limits = limits_of(peaks)
    for channel, limit, column in zip(channels(nominal.machine), limits, peaks.T):
        name = f"{channel.segment} {channel.column}"
        click.echo(f"{name:28s} median {np.median(column):7.2f}  largest {column.max():7.2f}  limit {limit:7.2f}")
    click.echo(
        f"at most {share_at_most(robots):.1%} of healthy robots raise an alarm in {minutes:g} min (95 % confidence)"
    )
    if write:
        write_text(write, limits_text(nominal, limits, seed, robots, minutes * MINUTE))
        click.echo(f"wrote {write}")
