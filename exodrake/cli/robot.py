"""`exodrake robot`: the parameters of a robot, with what its file states of them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import click

from exodrake.cli.options import robot_option

if TYPE_CHECKING:
    from exodrake.core.robot import Robot


@click.command()
@click.argument("name", required=False, default="", metavar="[NAME]")
@robot_option()
@click.option("--only", default="", metavar="TEXT", help="Parameters with this in their name, such as finger.kappa.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table, in SI.")
def command(name: str, robot: str, only: str, as_json: bool) -> None:
    """List each parameter of a robot with value, unit, plausible range, tolerance and source.

    NAME is a machine or a robot file, as for --robot. Below the parameters come effects in the robot, limits,
    parts and references.
    """
    from exodrake.core.errors import InputError, nearest
    from exodrake.core.plain import to_dict
    from exodrake.machines.robot_file import load_robot

    found = load_robot(name or robot)
    names = [one for one in found.parameters() if only in one]
    if not names:
        raise InputError(
            f"{found.source}: no parameter with {only!r} in its name{nearest(only, list(found.parameters()))}"
        )
    if as_json:
        content = to_dict(found)
        content["parameters"] = {one: content["parameters"][one] for one in names}
        click.echo(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False))
        return
    show(found, names, bool(only))


def show(robot: Robot, names: list[str], some: bool) -> None:
    """Prints the table, and what else the robot file holds unless some parameters were chosen."""
    from rich.console import Console
    from rich.markup import escape

    from exodrake.core.robot import alike, effect_in_words, implausible
    from exodrake.report.terminal import table

    console = Console(width=None if Console().is_terminal else 150)
    rows, group = [], ""
    for name, channels, one in alike(robot):
        if one.name not in names and not any(f"{name}.{channel}" in names for channel in channels):
            continue
        rows += [()] if group and name.split(".")[0] != group else []
        group, texts = name.split(".")[0], one.texts
        at = "" if not channels else " " + ", ".join(channels)
        rows.append(
            (f"[bold]{escape(name)}[/bold]{at}", texts["value"], texts["range"], texts["tolerance"], escape(one.source))
        )
    machine = robot.machine
    console.print(
        f"[bold]{escape(robot.source or machine.name)}[/bold]  machine {machine.name}, {len(names)} parameters"
    )
    console.print(table(("parameter", ">value", "plausible", "tolerance", "source"), rows, wrapped=4))
    for sentence in implausible(robot):
        console.print(f"[yellow]note[/yellow]  {escape(sentence)}")
    if some:
        return
    for identity in robot.effects():
        console.print(f"with {escape(effect_in_words(robot, identity))}", highlight=False)
    unit = machine.signal[machine.references[0].signal].unit
    for title, values in (("limit", robot.limits), ("grasp", robot.grasps)):
        for name, item in values.items():
            listed = ", ".join(f"{channel} {value:g}" for channel, value in item.items())
            console.print(f"{title} [bold]{escape(name)}[/bold]  {listed} {unit}", highlight=False)
    variants = ", ".join(machine.variants_available)
    console.print(f"variants of parts: {variants}" if variants else "no variants of parts", style="dim")
    console.print(f"set one: exodrake simulate ... --set '{names[0]}=VALUE UNIT'", style="dim", highlight=False)
