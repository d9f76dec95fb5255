"""`exodrake feedforward`: the commands that make a robot do what is wanted, by its model."""

from __future__ import annotations

from pathlib import Path

import click

from exodrake.cli.options import OutputFile, robot_option


@click.command()
@click.argument("wanted")
@robot_option()
@click.option("--out", required=True, type=OutputFile(), metavar="FILE", help="Log of the commands.")
def command(wanted: str, robot: str, out: Path) -> None:
    """Find the commands with which the robot does what WANTED asks, and write them as a log of references.

    WANTED is a protocol such as random-motion, or a log whose references are what is wanted. With the improved robot of
    a diagnosis, the commands make up for what was found: delay, play, sag, gain.
    """
    import numpy as np
    from rich.console import Console

    from exodrake.analysis.feedforward import feedforward
    from exodrake.cli.diagnose import check_target
    from exodrake.core.display import display_of
    from exodrake.core.files import is_file
    from exodrake.data.formats import format_of
    from exodrake.data.log import Log
    from exodrake.data.log_file import write_log
    from exodrake.machines.robot_file import load_robot
    from exodrake.report.terminal import table
    from exodrake.simulation.references import from_log, protocol

    check_target(out)
    format_of(out)
    built = load_robot(robot)
    machine = built.machine
    reference = from_log(wanted, built) if is_file(wanted) else protocol(wanted, built)
    with Console(stderr=True).status("simulating (the first run after a change compiles for half a minute)"):
        found = feedforward(built, reference)
    names = machine.log_names(machine.references)
    signals = dict(zip(names, found.commands.values.T, strict=True))
    units = {name: machine.signal[c.signal].unit for c in machine.references for name in machine.log_names([c])}
    write_log(Log(machine.frame * np.arange(len(reference.values)), signals, units, "commands"), out)
    shown = display_of(found.kind, machine)
    ends = [[f"{shown.factor * value:.3g} {shown.unit}" for value in one] for one in (found.before, found.after)]
    rows = list(zip(machine.channels(machine.references[0].signal), *ends, strict=True))
    Console(highlight=False).print(table(("channel", ">RMS error if sent as wanted", ">with these commands"), rows))
    click.echo(f"written {out}; the errors are those of the model")
