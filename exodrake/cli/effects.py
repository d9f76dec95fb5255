"""`exodrake effects`: the effect library, and the description of each effect."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import click

from exodrake.cli.options import DEFAULT, robot_option

if TYPE_CHECKING:
    from exodrake.core.effect import Effect, EffectParameter
    from exodrake.core.machine import Machine


@click.command()
@click.argument("identity", required=False, default="", metavar="[ID]")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
@robot_option()
def command(identity: str, as_json: bool, robot: str) -> None:
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
