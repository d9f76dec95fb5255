"""`exodrake simulate`: a robot on a protocol; its log, scenario, figure and a recording to look at."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from exodrake.cli.options import robot_option

if TYPE_CHECKING:
    from rich.table import Table

    from exodrake.core.robot import Robot
    from exodrake.data.log import Log
    from exodrake.simulation.scenario import Scenario

MANY = {"multiple": True, "metavar": "TEXT"}


@click.command()
@click.argument("protocol", required=False, default="")
@click.option("--reference", default="", metavar="LOG", help="Follow the references of this log.")
@click.option("--scenario", "file", default="", metavar="FILE", help="Repeat this scenario; other options change it.")
@robot_option(default="")
@click.option("--set", "parameters", **MANY, help="finger.kappa.MCP=0.09, or 'tendon.k=2.7 N/mm'. Repeatable.")
@click.option(
    "--effect", "effects", **MANY, help="ID[:name=value,...][@AF,MF]; `exodrake effects` lists them. Repeatable."
)
@click.option(
    "--part",
    "parts",
    **MANY,
    help="A variant part: controller_as_printed, routers_as_printed, finger_at_rest. Repeatable.",
)
@click.option("--seed", type=int, default=None, help="Seed of the noise [0].")
@click.option("--no-noise", is_flag=True, help="Sensors without noise, a bus that loses nothing.")
@click.option("--no-quantisation", is_flag=True, help="Readings unrounded.")
@click.option(
    "--engine", default="", metavar="NAME", help="compiled (the default) or drake: the same log to the last bit."
)
@click.option("--out", type=click.Path(path_type=Path), default=None, help="Folder for the files [simulated/PROTOCOL].")
def command(protocol: str, reference: str, file: str, robot: str, out: Path | None, **options) -> None:
    """Run a robot on PROTOCOL and write log.csv, scenario.yaml, figure.png and recording.html.

    PROTOCOL is a grasp mode (caging, narrow-pinch, wide-pinch) or one of sweeps, short-sweeps, chirp, holds, steps,
    multisine, random-motion; options of its own follow a colon: `caging:hold=4`, `chirp:low=0.1,high=1.5`.
    """
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from exodrake.core.files import write_folder
    from exodrake.data.log_file import log_bytes

    scenario = scenario_of(protocol, reference, file, robot)
    scenario, built = changed(scenario, options)
    what = scenario.build_reference(built)
    folder = out or Path("simulated") / what.name
    check_folder(folder)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=stderr(), transient=True, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task("simulating (the first run after a change compiles for half a minute)")
        log = scenario.simulate(built, what)
        contents = files_of(scenario, built, log, what.name, lambda text: progress.update(task, description=text))
        files = write_folder(folder, {"log.csv": log_bytes(log, folder / "log.csv"), **contents})
    show(built, log, folder, [file.name for file in files])
    warn(built)


def stderr():
    """A console on standard error, so that a pipe gets no spinner."""
    from rich.console import Console

    return Console(stderr=True)


def scenario_of(protocol: str, reference: str, file: str, robot: str) -> Scenario:
    """The scenario that the first four options ask for; those given replace the file's."""
    from exodrake.core.errors import InputError
    from exodrake.simulation.scenario import Scenario, embedded, read_scenario

    if protocol and reference:
        raise InputError("both a protocol and --reference: wanted one of them")
    if not (protocol or reference or file):
        raise InputError("nothing to follow: name a protocol or grasp mode (see --help), a --reference or a --scenario")
    if not file:
        there = Scenario(protocol, reference)
    else:
        there = read_scenario(file)
        if protocol or reference:
            there = replace(there, protocol=protocol, reference=reference)
    return replace(there, robot=embedded(robot)) if robot else there


def changed(scenario: Scenario, options: dict) -> tuple[Scenario, Robot]:
    """The scenario with options applied in the order variants, parameters, effects, and its robot."""
    from exodrake.simulation.scenario import parse_effect, parse_number

    if options["seed"] is not None:
        scenario = replace(scenario, seed=options["seed"])
    if options["no_noise"]:
        scenario = replace(scenario, seed=None)
    if options["no_quantisation"]:
        scenario = replace(scenario, quantisation=False)
    if options["engine"]:
        scenario = replace(scenario, engine=options["engine"])
    scenario = replace(scenario, parts=list(dict.fromkeys([*scenario.parts, *options["parts"]])))
    robot = scenario.build_robot()
    parameters = dict(parse_number(text, robot) for text in options["parameters"])
    scenario = replace(scenario, parameters={**scenario.parameters, **parameters})
    for text in options["effects"]:
        identity, given = parse_effect(text, scenario.build_robot())
        scenario = replace(scenario, effects={**scenario.effects, identity: given})
    return scenario, scenario.build_robot()


def files_of(scenario: Scenario, robot: Robot, log: Log, name: str, say) -> dict[str, bytes]:
    """Contents of all files but the log. A scenario that followed a log refers to the log written beside it."""
    from exodrake.data.plot import png_of
    from exodrake.diagrams.meshcat import recording_html
    from exodrake.diagrams.meshcat.shapes import has_finger
    from exodrake.simulation.scenario import scenario_text

    again = replace(scenario, reference="log.csv") if scenario.reference else scenario
    title = ", ".join([name.replace("-", " "), *robot.effects()])
    say("drawing the figure")
    figure = png_of(log.plot(title, machine=robot.machine))
    files = {"scenario.yaml": scenario_text(again).encode(), "figure.png": figure}
    if has_finger(robot):
        say("drawing the recording")
        files["recording.html"] = recording_html(log, robot, title).encode()
    return files


def check_folder(folder: Path) -> None:
    """InputError unless the folder is one, or can be made, and takes files."""
    from exodrake.core.errors import InputError

    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: a file, wanted a folder")
    parent = folder
    while not parent.exists():
        parent = parent.parent
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise InputError(f"{folder}: {parent} takes no files")


def show(robot: Robot, log: Log, folder: Path, names: list[str]) -> None:
    """Prints how well the references were followed, where the joints went, and the files."""
    from rich.console import Console
    from rich.markup import escape

    console = Console()
    console.print(f"[bold]{escape(log.label)}[/bold]  {log.duration:g} s, {len(log)} rows")
    for identity in robot.effects():
        console.print(f"with {identity}")
    console.print(tendon_table(robot, log) if log.has("tension_ref") else channel_table(robot, log))
    console.print(f"[bold]{escape(str(folder))}/[/bold]  {'  '.join(names)}", soft_wrap=True)


def tendon_table(robot: Robot, log: Log) -> Table:
    """Tensions wanted and reached, and where the joints went."""
    from rich.table import Table

    axes = robot.machine.axes
    wanted, found, angle = log.array("tension_ref"), log.array("tension"), log.array("angle")
    shares = wanted.sum(axis=1)
    peak = len(shares) - 1 - int(shares[::-1].argmax())  # the end of a hold
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in (
        "tendon",
        "wanted up to",
        "reached",
        "RMS error",
        "",
        "joint",
        f"at {log.time[peak]:.2f} s",
        "in the end",
    ):
        table.add_column(title, justify="left" if title in ("tendon", "joint", "") else "right")
    for i in range(max(len(axes.tendons), len(axes.joints))):
        tendon = ("", "", "", "")
        if i < len(axes.tendons):
            error = float(((wanted[:, i] - found[:, i]) ** 2).mean() ** 0.5)
            tendon = (axes.tendons[i], f"{wanted[:, i].max():.2f} N", f"{found[:, i].max():.2f} N", f"{error:.3f} N")
        joint = (axes.joints[i], f"{angle[peak, i]:.3f} rad", f"{angle[-1, i]:.3f} rad") if i < len(axes.joints) else ()
        table.add_row(*tendon, "  ", *joint)
    return table


def channel_table(robot: Robot, log: Log) -> Table:
    """Range of each measured channel, and how far it was from its reference."""
    from exodrake.core.display import display_of
    from exodrake.report.terminal import table

    machine, rows = robot.machine, []
    for column in machine.columns:
        if column in machine.references:
            continue
        shown = display_of(column.kind, machine)
        for channel in machine.axes.of(machine.signal[column.signal].axis):
            values, reference = log[f"{column.kind}_{channel}"], f"{column.kind}_ref_{channel}"
            error = (values - log[reference]) if log.has(reference) else None
            cells = [values.min(), values.max(), values[-1], *([] if error is None else [(error**2).mean() ** 0.5])]
            texts = [f"{shown.factor * float(cell):.3g} {shown.unit}" for cell in cells]
            rows.append((shown.label, channel, *texts, *[""] * (4 - len(texts))))
    return table(("signal", "channel", ">lowest", ">highest", ">in the end", ">RMS error"), rows)


def warn(robot: Robot) -> None:
    """Says which parameters lie outside their plausible range."""
    for name, (low, high) in robot.ranges.items():
        if not low <= robot[name] <= high:
            click.secho(f"note: {name} = {robot[name]:g} lies outside {low:g} to {high:g}", fg="yellow", err=True)
