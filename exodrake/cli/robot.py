"""`exodrake robot`, `effects` and `draw`: a robot's parameters, its effect library, its parts; `fit`, to its logs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.markup import escape

import exodrake as exo
from exodrake.cli import options
from exodrake.core import plugins
from exodrake.core.errors import InputError, nearest

if TYPE_CHECKING:
    from exodrake.model.effect import Effect


@options.command()
@click.argument("name", required=False, default="", metavar="[NAME]")
@options.robot_option()
@click.option("--only", default="", metavar="TEXT", help="Parameters with this in their name, such as finger.kappa.")
def list_parameters(name: str, robot: str, only: str) -> dict[str, Any]:
    """List each parameter of a robot with value, unit, plausible range, tolerance and source.

    NAME is a machine or a robot file, as for --robot, or part of a parameter's name, as for --only.
    """
    from exodrake.machines.robot_file import robot_files
    from exodrake.model.robot import alike, effect_in_words, implausible

    if name and not (Path(name).suffix == ".yaml" or Path(name).exists() or name in robot_files()):
        full = list(exo.load_robot(robot).parameters())
        if not any(name in one for one in full):
            words = [*robot_files(), *dict.fromkeys(one.rpartition(".")[0] for one in full), *full]
            raise InputError(f"no robot, nor a parameter, with {name!r} in its name{nearest(name, words)}")
        name, only = "", name
    found = exo.load_robot(name or robot)
    known = found.parameters()
    names = [one for one in known if only in one]
    if not names:
        raise InputError(f"{found.source}: no parameter with {only!r} in its name{nearest(only, list(known))}")
    content = exo.to_dict(found)
    rows, group = [], ""
    for full, channels, one in alike(found):
        if one.name in names or any(f"{full}.{channel}" in names for channel in channels):
            rows += [()] if group and full.split(".")[0] != group else []
            group, texts, at = full.split(".")[0], one.texts, ", ".join(channels)
            values = texts["value"], texts["range"], texts["tolerance"], escape(one.source)
            rows.append((f"[bold]{escape(full)}[/bold] {at}".rstrip(), *values))
    click.echo(f"{found.source or found.machine.name}: machine {found.machine.name}, {len(names)} parameters")
    options.print_table(("parameter", ">value", "plausible", "tolerance", "source"), rows, wrapped=4)
    for sentence in implausible(found):
        click.echo(f"note  {sentence}")
    if not only:
        machine, unit = found.machine, found.machine.signal[found.machine.references[0].signal].unit
        for identity in found.effects():
            click.echo(f"with {effect_in_words(found, identity)}")
        for title, values in (("limit", found.limits), ("grasp", found.grasps)):
            for key, item in values.items():
                listed = ", ".join(f"{channel} {value:g}" for channel, value in item.items())
                click.echo(f"{title} {key}  {listed} {unit}")
        click.echo(f"variants of parts: {', '.join(machine.variants_available) or 'none'}")
        click.echo(f"set one: exodrake simulate ... --set '{names[0]}=VALUE UNIT'")
    return content | {"parameters": {one: content["parameters"][one] for one in names}}


@options.command()
@click.argument("identity", required=False, default="", metavar="[ID]")
@options.robot_option()
def list_effects(identity: str, robot: str) -> Any:
    """List the effect library: id, what it is, parameters with unit and plausible range.

    With ID, all about one effect, or a list of those that have the text in their id, or else in what they are.
    """
    machine = exo.load_robot(robot).machine
    within = [effect for effect in machine.effects if identity in effect.id]
    within = within or [effect for effect in machine.effects if identity in f"{effect.family}, {effect.summary}"]
    exact = [effect for effect in within if effect.id == identity]
    chosen = exact or within or [machine.effect(identity)]
    single = bool(identity) and len(chosen) == 1
    described = [describe(machine, effect) for effect in chosen]
    rows, block = [], ""
    if single:
        effect = chosen[0]
        click.echo(f"{click.style(effect.id, bold=True)}  {effect.summary}\n\n{effect.equation}\n")
        for n in effect.parameters:
            channels = ", ".join(filter(None, machine.axes.of(n.axis))) or "robot"
            null = f"{n.null:g}" if n is effect.parameters[0] else ""
            ends = f"{n.low:g} to {n.high:g}"
            rows.append((n.name, n.unit, ends, f"{n.initial:.4g}", null, channels, "yes" if n.fitted else "no"))
        options.print_table(("parameter", "unit", "plausible", ">initial", ">null value", "one per", "fitted"), rows)
        texts = {"shows as": effect.signature, "acts at": ", ".join(effect.at), "source": effect.source}
        for title, text in (texts | {"try": example(machine, effect)}).items():
            click.echo(f"\n{click.style(title, bold=True)}\n{text}")
        return described[0]
    for effect in chosen:
        rows += [()] if block and effect.block != block else []
        block = effect.block
        ends = (f"{n.name}  {n.low:g} to {n.high:g} {n.unit}".removesuffix(" -") for n in effect.parameters)
        per = effect.axis.removesuffix("s") or "robot"
        rows.append((f"[bold]{effect.id}[/bold]", effect.summary, "\n".join(ends), per))
    options.print_table(("effect", "what it is", "parameters", "per"), rows, wrapped=1)
    click.echo(f"\n{len(chosen)} effects. `exodrake effects ID` describes one.")
    return described


def describe(machine: exo.Machine, effect: Effect) -> dict[str, Any]:
    """Everything about an effect as plain data."""
    parameters = [
        {
            "name": n.name, "unit": n.unit, "null": n.null if math.isfinite(n.null) else str(n.null),
            "range": [n.low, n.high], "initial": n.initial if math.isfinite(n.initial) else str(n.initial),
            "axis": n.axis or "scalar", "channels": list(filter(None, machine.axes.of(n.axis))), "fitted": n.fitted,
        }
        for n in effect.parameters
    ]  # fmt: skip
    return {
        "id": effect.id, "block": effect.block, "summary": effect.summary, "signature": effect.signature,
        "source": effect.source, "acts_at": list(effect.at), "parameters": parameters, "equation": effect.equation,
        "example": example(machine, effect),
    }  # fmt: skip


def example(machine: exo.Machine, effect: Effect) -> str:
    """A command that shows the effect."""
    parameter, channel = effect.parameters[0], machine.axes.of(effect.axis)[0]
    own = plugins.single_machines().get(machine.name)
    which = f"--machine {own}" if own else f"--robot {machine.name}"
    what = "caging" if machine.name == options.DEFAULT else f"chirp {which}"
    at = f"@{channel}" if channel else ""
    return f"exodrake simulate {what} --effect {effect.id}:{parameter.name}={parameter.initial:.3g}{at}"


@options.command()
@options.robot_option()
@click.option("--out", required=True, type=options.OutputFile("wiring.svg"), help="SVG to write, or a folder for it.")
def draw(robot: str, out: Path) -> None:
    """Draw the robot's block diagram: parts, signals with their units, and the tasks in the slots of a frame."""
    machine = exo.load_robot(robot).machine
    options.write_files({out: exo.wiring_svg(machine)})
    click.echo(f"{len(machine.parts)} parts joined by {len(machine.signals)} signals")


@options.command()
@options.CASE
@click.option("--free", multiple=True, required=True, metavar="NAME",
              help="Parameter to fit, such as finger.kappa. Repeatable.")  # fmt: skip
@click.option("--bounds", multiple=True, metavar="NAME=LOW..HIGH",
              help="Range of one, with units or in SI. Repeatable.")  # fmt: skip
@click.option("--held-out", multiple=True, metavar="LOG", help="Log that is not fitted. Repeatable.")
@click.option("--prediction", is_flag=True, help="Fit prediction errors beside output errors.")
@options.robot_changes
@click.option("--out", type=options.OutputFolder(), help="Folder for robot.yaml, fit.png and fit.json.")
def fit_parameters(cases, free, bounds, held_out, prediction, out, **changes) -> object:
    """Fit parameters of a robot to logs by least squares, with 90 % intervals that allow for coloured residuals.

    CASE_OR_LOG is a case folder, whose held-out logs are held out, or one or several logs. A name without channel
    frees each channel; names in one text, separated by blanks, move together. --effect puts an effect into the robot
    whose parameters may be fitted.
    """
    from exodrake.machines.robot_file import robot_text

    limits = {}
    for text in bounds:
        name, equals, span = text.partition("=")
        low, dots, high = span.partition("..")
        if not equals or not dots:
            raise InputError(f"--bounds: {text!r} is not of the form NAME=LOW..HIGH")
        limits[name.strip()] = (low, high)
    with options.waiting("fitting (the first run after a change compiles for half a minute)"):
        robot = options.load_changed(**changes)
        found = exo.fit(robot, cases[0] if len(cases) == 1 else cases, free, limits, held_out, prediction)
    for titles, rows in found.tables:
        options.print_table([escape(title).replace("held out, ", "held out\n") for title in titles], rows)
        click.echo()
    for line in (repr(found).splitlines()[-1].strip(), *(f"note: {note}" for note in found.notes)):
        click.echo(line)
    robot_file = robot_text(found.robot, f"{', '.join(free)} fitted to {found.case} by exodrake fit")
    files = {"robot.yaml": robot_file, "fit.png": found.plot()} if out else {}
    return options.write_answer(found.to_dict(), "fit", out, files)
