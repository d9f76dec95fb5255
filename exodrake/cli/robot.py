"""`exodrake robot`, `effects` and `draw`: a robot's parameters, its effect library, its parts and signals."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from exodrake.cli.options import DEFAULT, AnyPath, robot_option

if TYPE_CHECKING:
    from exodrake.core.effect import Effect, EffectParameter
    from exodrake.core.machine import Machine
    from exodrake.core.robot import Robot


@click.command()
@click.argument("name", required=False, default="", metavar="[NAME]")
@robot_option()
@click.option("--only", default="", metavar="TEXT", help="Parameters with this in their name, such as finger.kappa.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table, in SI.")
def list_parameters(name: str, robot: str, only: str, as_json: bool) -> None:
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


@click.command()
@click.argument("identity", required=False, default="", metavar="[ID]")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
@robot_option()
def list_effects(identity: str, as_json: bool, robot: str) -> None:
    """List the effect library: id, what it is, parameters with unit and plausible range; with ID, all about one."""
    from exodrake.machines.robot_file import load_robot

    machine = load_robot(robot).machine
    chosen = [machine.effect(identity)] if identity else list(machine.effects)
    if as_json:
        described = [describe(machine, effect) for effect in chosen]
        click.echo(json.dumps(described[0] if identity else described, indent=2, ensure_ascii=False, allow_nan=False))
    elif identity:
        print_description(machine, chosen[0])
    else:
        print_library(chosen)


def finite(value: float) -> float | str:
    """A number as JSON takes it: an infinite one as text."""
    return value if math.isfinite(value) else str(value)


def describe(machine: Machine, effect: Effect) -> dict[str, Any]:
    """Everything about an effect as plain data."""
    parameters = [
        {
            "name": n.name, "unit": n.unit, "null": finite(n.null),
            "range": [n.low, n.high], "initial": finite(n.initial), "axis": n.axis or "scalar",
            "channels": [channel for channel in machine.axes.of(n.axis) if channel], "fitted": n.fitted,
        }
        for n in effect.parameters
    ]  # fmt: skip
    return {
        "id": effect.id, "block": effect.block, "summary": effect.summary, "signature": effect.signature,
        "source": effect.source, "acts_at": list(effect.at), "parameters": parameters, "equation": effect.equation,
        "example": example(machine, effect),
    }  # fmt: skip


def example(machine: Machine, effect: Effect) -> str:
    """A command that shows the effect."""
    parameter = effect.parameters[0]
    channel = machine.axes.of(effect.axis)[0]
    at = f"@{channel}" if channel else ""
    what = "caging" if machine.name == DEFAULT else f"chirp --robot {machine.name}"
    return f"exodrake simulate {what} --effect {effect.id}:{parameter.name}={parameter.initial:.3g}{at}"


def plausible(parameter: EffectParameter) -> str:
    """Plausible range with unit."""
    unit = "" if parameter.unit == "-" else f" {parameter.unit}"
    return f"{parameter.low:g} to {parameter.high:g}{unit}"


def print_library(effects: list[Effect]) -> None:
    """A table, one row an effect, grouped by block."""
    from rich.console import Console

    from exodrake.report.terminal import table

    rows, block = [], ""
    for effect in effects:
        rows += [()] if block and effect.block != block else []
        block = effect.block
        parameters = "\n".join(f"{n.name}  {plausible(n)}" for n in effect.parameters)
        per = effect.axis.removesuffix("s") or "robot"
        rows.append((f"[bold]{effect.id}[/bold]", effect.summary, parameters, per))
    console = Console(width=None if Console().is_terminal else 140)
    console.print(table(("effect", "what it is", "parameters", "per"), rows, wrapped=1))
    console.print(f"\n{len(effects)} effects. `exodrake effects ID` describes one.", style="dim")


def print_description(machine: Machine, effect: Effect) -> None:
    """All about one effect."""
    from rich.console import Console

    from exodrake.report.terminal import table

    console = Console(width=None if Console().is_terminal else 120)
    console.print(f"[bold]{effect.id}[/bold]  {effect.summary}\n")
    console.print(effect.equation, markup=False, highlight=False, style="cyan", soft_wrap=True)
    rows = []
    for n in effect.parameters:
        channels = ", ".join(filter(None, machine.axes.of(n.axis))) or "robot"
        null = f"{n.null:g}" if n is effect.parameters[0] else ""
        ends = f"{n.low:g} to {n.high:g}"
        rows.append((n.name, n.unit, ends, f"{n.initial:.4g}", null, channels, "yes" if n.fitted else "no"))
    titles = ("parameter", "unit", "plausible", ">initial", ">null value", "one per", "fitted")
    console.print()
    console.print(table(titles, rows))
    for title, text in (("shows as", effect.signature), ("acts at", ", ".join(effect.at)), ("source", effect.source)):
        console.print(f"\n[bold]{title}[/bold]")
        console.print(text, markup=False, highlight=False)
    console.print("\n[bold]try[/bold]")
    console.print(example(machine, effect), markup=False, highlight=False, soft_wrap=True)


@click.command()
@robot_option()
@click.option("--out", default="wiring.svg", show_default=True, type=AnyPath(dir_okay=False))
def draw(robot: str, out: Path) -> None:
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
