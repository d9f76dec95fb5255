"""`exodrake effects`: the effect library of what the nominal robot leaves out, and the page of each effect."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from exodrake.core.effect import Effect, EffectParameter
    from exodrake.core.machine import Machine


@click.command()
@click.argument("identity", required=False, default="", metavar="[ID]")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
@click.option(
    "--robot", default="exo_index", metavar="FILE", help="Whose effect library: a robot file or built-in robot."
)
def command(identity: str, as_json: bool, robot: str) -> None:
    """The effect library of effects: id, what it is, parameters with unit and plausible range; one page if ID is
    given.
    """
    from exodrake.machines.robot_file import load_robot

    machine = load_robot(robot).machine
    chosen = [machine.effect(identity)] if identity else list(machine.effects)
    if as_json:
        described = [describe(machine, effect) for effect in chosen]
        click.echo(json.dumps(described[0] if identity else described, indent=2, ensure_ascii=False, allow_nan=False))
    elif identity:
        print_page(machine, chosen[0])
    else:
        print_library(machine, chosen)


def equation(effect: Effect) -> str:
    """The effect's equation: the docstring of its module."""
    import sys
    from inspect import cleandoc

    return cleandoc(sys.modules[next(iter(effect.at.values())).__module__].__doc__ or "")


def finite(value: float) -> float | str:
    """A number as JSON takes it: an infinite one as text."""
    return value if math.isfinite(value) else str(value)


def describe(machine: Machine, effect: Effect) -> dict[str, Any]:
    """Everything about an effect as plain data."""
    parameters = [
        {
            "name": n.name, "unit": n.unit, "neutral": finite(n.null),
            "range": [n.low, n.high], "usual": finite(n.initial), "over": n.axis or "one",
            "channels": [channel for channel in machine.axes.of(n.axis) if channel], "free": n.fitted,
        }
        for n in effect.parameters
    ]  # fmt: skip
    return {
        "id": effect.id, "block": effect.block, "summary": effect.summary, "signature": effect.signature,
        "source": effect.source, "acts_at": list(effect.at), "parameters": parameters, "equation": equation(effect),
        "example": example(machine, effect),
    }  # fmt: skip


def example(machine: Machine, effect: Effect) -> str:
    """A command that shows the effect."""
    number = effect.parameters[0]
    channel = machine.axes.of(effect.axis)[0]
    at = f"@{channel}" if channel else ""
    return f"exodrake simulate caging --effect {effect.id}:{number.name}={number.initial:.3g}{at}"


def reach(number: EffectParameter) -> str:
    """Plausible range with unit."""
    unit = "" if number.unit == "-" else f" {number.unit}"
    return f"{number.low:g} to {number.high:g}{unit}"


def print_library(machine: Machine, effects: list[Effect]) -> None:
    """A table, one row an effect, grouped by block."""
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    table.add_column("effect", no_wrap=True)
    table.add_column("what it is", ratio=1)
    table.add_column("parameters", no_wrap=True)
    table.add_column("per", no_wrap=True)
    block = ""
    for effect in effects:
        if block and effect.block != block:
            table.add_row()
        block = effect.block
        parameters = "\n".join(f"{n.name}  {reach(n)}" for n in effect.parameters)
        per = {"wires": "wire", "joints": "joint"}.get(effect.axis, "robot")
        table.add_row(f"[bold]{effect.id}[/bold]", effect.summary, parameters, per)
    console = Console(width=None if Console().is_terminal else 140)
    console.print(table)
    console.print(f"\n{len(effects)} effects. `exodrake effects ID` prints an effect's page.", style="dim")


def print_page(machine: Machine, effect: Effect) -> None:
    """The full page of one effect."""
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if Console().is_terminal else 120)
    console.print(f"[bold]{effect.id}[/bold]  {effect.summary}\n")
    console.print(equation(effect), markup=False, highlight=False, style="cyan", soft_wrap=True)
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 3, 0, 0))
    for title in ("\nparameter", "\nunit", "\nplausible", "\nusual", "\nabsent at", "\none per", "\nfitted"):
        table.add_column(title)
    for n in effect.parameters:
        channels = ", ".join(filter(None, machine.axes.of(n.axis))) or "robot"
        absent = f"{n.null:g}" if n is effect.parameters[0] else ""
        ends = f"{n.low:g} to {n.high:g}"
        table.add_row(n.name, n.unit, ends, f"{n.initial:.4g}", absent, channels, "yes" if n.fitted else "no")
    console.print(table)
    for title, text in (("shows as", effect.signature), ("acts at", ", ".join(effect.at)), ("source", effect.source)):
        console.print(f"\n[bold]{title}[/bold]")
        console.print(text, markup=False, highlight=False)
    console.print("\n[bold]try[/bold]")
    console.print(example(machine, effect), markup=False, highlight=False, soft_wrap=True)
