"""`exodrake alarm-limits`: gaps that healthy robots stay below, for the alarm of `exodrake watch`."""

from __future__ import annotations

from pathlib import Path

import click

from exodrake.cli.options import AnyPath, robot_option
from exodrake.core.progress import where_to_run


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
def command(
    robot: str, seed: int, robots: int, minutes: float, write: Path | None, jobs: int, cluster: str | None
) -> None:
    """Find gaps that healthy robots stay below, from simulated ones at work whose parameters lie within tolerance."""
    import numpy as np

    from exodrake.cli.diagnose import check_target
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
