"""`exodrake watch` follows a growing log and raises an alarm when the robot leaves its model; `alarm-limits`."""

import sys
from contextlib import suppress
from pathlib import Path

import click

import exodrake as exo
from exodrake.cli import options
from exodrake.core.progress import where_to_run

REDRAW = 4  # times a second
EVERY = 10  # s of the log between plain lines


@options.command()
@click.argument("log", type=options.AnyPath())
@options.robot_option()
@click.option("--until-idle", type=click.FloatRange(min=0), metavar="TIME",
              help="End when no row has come for this time [s; never]; 0 reads a complete log to its end.")  # fmt: skip
@click.option("--map", "map_file", type=options.AnyPath(), metavar="FILE", help="Mapping file of a foreign recording.")
def command(log: Path, robot: str, until_idle: float | None, map_file: Path | None) -> object:
    """Follow LOG, a CSV file that a robot is writing, and show the gap between each of its segments and the model.

    The model runs beside the robot, frame by frame. Ctrl-C ends with a summary. The exit status is 1 if there was an
    alarm. For the cause: `exodrake diagnose LOG`; for an animation: `exodrake show LOG`. A mapping file is that of
    `exodrake import`, of a growing file with names, units, scales, offsets and signs alone.
    """
    from rich.console import Console
    from rich.live import Live

    from exodrake.data.import_log import read_mapping
    from exodrake.monitor.display import describe_alarm, describe_reading, draw_screen, summarise
    from exodrake.monitor.watcher import Monitor, follow

    log = options.log_in(log)
    click.echo("loading the model (the first run compiles for half a minute)", err=True)
    monitor, printed = Monitor(exo.load_robot(robot)), 0
    readings = follow(monitor, log, until_idle, None if map_file is None else read_mapping(map_file))
    if not log.exists():
        click.echo(f"waiting for {log}", err=True)
    with suppress(KeyboardInterrupt):
        if sys.stdout.isatty():  # a display that is redrawn in place
            console = Console(highlight=False)
            with Live(draw_screen(monitor, log), console=console, refresh_per_second=REDRAW, transient=True) as live:
                for _ in readings:
                    live.update(draw_screen(monitor, log))
        else:
            for reading in readings:
                if reading is not None and reading.second % EVERY == 0:
                    click.echo(describe_reading(monitor, reading))
                for alarm in monitor.alarms[printed:]:
                    click.echo(describe_alarm(monitor, alarm, log))
                printed = len(monitor.alarms)
    click.echo("\n".join([*monitor.notes, *summarise(monitor, log)]))
    click.get_current_context().meta[options.STATUS] = int(bool(monitor.alarms))
    gaps = [] if monitor.reading is None else monitor.reading.overall
    overall = [{"segment": c.segment, "column": c.column, "gap": gap} for c, gap in zip(monitor.channels, gaps)]
    return {"frames": monitor.frames, "gaps": overall, "alarms": monitor.alarms, "notes": monitor.notes}


@options.command()
@options.robot_option()
@options.option("--seed", default=21, type=click.IntRange(min=0), help="Seed of all draws.")
@options.option("--robots", default=100, type=click.IntRange(min=2), help="Simulated healthy robots.")
@options.option("--minutes", default=20.0, type=click.FloatRange(min=0.5, max=1440), help="Work of each robot.")
@click.option("--out", "--write", "out", type=options.OutputFile("alarm_limits.yaml"),
              help="The machine's folder, where `watch` finds alarm_limits.yaml, or a file.")  # fmt: skip
@where_to_run
def find_alarm_limits(robot, seed, robots, minutes, out, jobs, cluster) -> object:
    """Find gaps that healthy robots stay below, from simulated ones at work whose parameters lie within tolerance."""
    import numpy as np
    import yaml

    from exodrake.model.display import percent
    from exodrake.monitor.alarm import MINUTE, choose_limits, measure_all_peaks, measure_noise, share_at_most
    from exodrake.simulation.segments import list_channels

    nominal = exo.load_robot(robot)
    noise, listed = measure_noise(nominal), list_channels(nominal.machine)
    peaks = measure_all_peaks(robot, noise, seed, robots, minutes * MINUTE, jobs=jobs, cluster=cluster)
    written: dict[str, dict[str, float]] = {}
    for channel, limit, column in zip(listed, choose_limits(peaks), peaks.T, strict=True):
        written.setdefault(channel.segment, {})[channel.column] = float(f"{limit:.4g}")
        name = f"{channel.segment} {channel.column}"
        click.echo(f"{name:28s} median {np.median(column):7.2f}  largest {column.max():7.2f}  limit {limit:7.2f}")
    share = percent(share_at_most(robots))
    click.echo(f"at most {share} of healthy robots raise an alarm in {minutes:g} min (95 % confidence)")
    content = {"robots": robots, "minutes": minutes, "limits": written}
    if out:
        head = (
            "# gaps over 10 s [noise standard deviations] above which the alarm is raised; made by\n#   exodrake "
            f"alarm-limits --robot {nominal.machine.name} --seed {seed} --robots {robots} --minutes {minutes:g}\n"
        )
        options.write_files({out: head + yaml.safe_dump(content, sort_keys=False)})
    return content
