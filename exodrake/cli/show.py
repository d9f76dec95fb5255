"""`exodrake show`: a log as a moving robot, in one HTML file that plays offline."""

from __future__ import annotations

from pathlib import Path

import click

from exodrake.cli.options import AnyPath, log_in, robot_option


@click.command()
@click.argument("log", type=AnyPath())
@robot_option()
@click.option("--out", type=AnyPath(), default=None, help="File to write [LOG with .html].")
@click.option("--estimated", is_flag=True, help="Show the estimated joint angles, not the measured ones.")
@click.option("--open", "show", is_flag=True, help="Open the file in the browser.")
def command(log: Path, robot: str, out: Path | None, estimated: bool, show: bool) -> None:
    """Write LOG as HTML with the moving robot, its tendons coloured by tension.

    LOG is a log file, or a folder that `exodrake simulate` wrote.
    `#t=1.5` at the end of the address stops it at that time.
    """
    from exodrake.core.files import write_text
    from exodrake.data.log_file import read_log
    from exodrake.diagrams.meshcat import recording_html
    from exodrake.machines.robot_file import load_robot

    kind = "angle_est" if estimated else ""
    file = log_in(log)
    html = recording_html(read_log(file), load_robot(robot), log.name or log.resolve().name, angles=kind)
    target = out or file.with_name(file.name.split(".")[0] + ".html")
    write_text(target, html)
    click.echo(f"{target}: {len(html) / 1e6:.1f} MB")
    if show:
        click.launch(str(target))
