"""`exodrake draw`: the robot's parts, signals and slots as an SVG."""

from pathlib import Path

import click

from exodrake.cli.options import AnyPath, robot_option


@click.command()
@robot_option()
@click.option("--out", default="wiring.svg", show_default=True, type=AnyPath(dir_okay=False))
def command(robot: str, out: Path) -> None:
    """Draw the robot's block diagram: parts, signals with their units, and the tasks in the slots of a frame."""
    from exodrake.core.errors import InputError
    from exodrake.core.files import write_text
    from exodrake.diagrams.block_diagram import wiring_svg
    from exodrake.machines.robot_file import load_robot

    machine = load_robot(robot).machine
    if out.suffix.lower() != ".svg":
        raise InputError(f"{out}: the drawing is an SVG; its name ends in .svg")
    write_text(out, wiring_svg(machine))
    names = ", ".join(part.name for part in machine.parts)
    click.echo(f"{out}: {len(machine.parts)} parts ({names}) joined by {len(machine.signals)} signals")
