"""`exodrake tune`: controllers of a robot's closed loop, tuned within stated requirements and compared.

`exodrake feedforward`: the commands that make a robot do what is wanted, by its model.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

import exodrake as exo
from exodrake.cli import options
from exodrake.core.errors import InputError
from exodrake.core.files import is_file

ABOVE = click.FloatRange(min=0.0, min_open=True)


@options.command()
@options.robot_option("file")
@options.robot_changes
@click.option("--settling", type=ABOVE, help="Wanted settling time to 2 % [s]; else as short as can be.")
@click.option("--overshoot", type=click.FloatRange(0.0, 100.0), default=5.0, help="Largest overshoot [%]. [5]")
@click.option("--disk-margin", type=click.FloatRange(0.0, 2.0, min_open=True), default=0.6,
              help="Least disk margin, all commands at once. [0.6]")  # fmt: skip
@click.option("--noise", type=ABOVE, help="Largest standard deviation of a command [SI]; else twice today's.")
@click.option("--controller", "only", multiple=True, metavar="NAME", help="Tune this structure only. Repeatable.")
@click.option("--draws", type=click.IntRange(0, 100), default=4,
              help="Robots within tolerances that the search sees. [4]")  # fmt: skip
@click.option("--out", type=options.OutputFolder(), help="Folder for tuned.yaml, tune.png and tune.json.")
@click.option("--out-robot", type=options.OutputFile("tuned.yaml"),
              help="Write the robot with the best controller alone.")  # fmt: skip
def command(
    file, parameters, effects, parts, settling, overshoot, disk_margin, noise, only, draws, out, out_robot
) -> Any:  # fmt: skip
    """Choose the gains of a robot's closed loop that settle fastest within requirements.

    They hold at every operating point of the machine and for robots within the tolerances. Every controller that the
    machine knows is tuned and compared; the fastest that holds all requirements is written as a robot file.
    """
    from exodrake.analysis.figures import plot_tuning
    from exodrake.machines.robot_file import robot_text

    robot = options.change_robot(exo.load_robot(file), parameters, effects, parts)
    if out_robot and robot.machine.loop and robot.machine.loop.outer:
        raise InputError("--out-robot: the gains are those of an outer loop, which no robot file holds")
    wanted = exo.Requirements(settling, overshoot / 100.0, disk_margin, noise)
    with options.waiting("tuning") as say:
        tuning = exo.tune(robot, wanted, only, draws, progress=lambda name: say(f"tuning: {name}"))
    show(tuning)
    files: dict[str, Any] = {"tune.png": plot_tuning(tuning)} if out else {}
    if tuning.best and (out or out_robot) and not (robot.machine.loop and robot.machine.loop.outer):
        best = tuning.best
        notes = (
            f"controller {best.name} by exodrake tune: overshoot up to {100.0 * wanted.overshoot:g} %, disk margin "
            f"from {wanted.disk_margin:g}; worst over operating points and tolerances: settles in "
            f"{best.settling:.3g} s, overshoot {round(100.0 * best.overshoot, 2):.2g} %, disk margin "
            f"{best.disk_margin:.2g}"
        )
        files["tuned.yaml"] = robot_text(best.robot, notes)
    answer = options.write_answer(tuning.to_dict(), "tune", out, files)
    if out_robot and tuning.best:
        options.write_files({out_robot: files["tuned.yaml"]})
    if out_robot and not tuning.best:
        raise InputError("no controller holds all requirements: no robot file written")
    return answer


def show(tuning: exo.Tuning) -> None:
    """The controllers as a table, and the best one's gains."""
    from exodrake.analysis.tuning import word_gains
    from exodrake.model.display import shown_unit

    unit, factor = shown_unit(tuning.noise_unit)
    titles = (">settling\n\\[s]", ">overshoot\n\\[%]", ">disk margin\n\\[-]", f">noise\n\\[{unit}]")
    rows = []
    for t in tuning.compared:
        numbers = (f"{t.settling:.3g}", f"{round(100.0 * t.overshoot, 2):.2g}", f"{t.disk_margin:.3g}")
        cells = ("-" if cell == "nan" else cell for cell in (*numbers, f"{factor * t.noise:.3g}"))
        rows.append((t.name, *cells, ", ".join(t.missed)))
    options.print_table(("controller", *titles, "misses"), rows)
    w = tuning.requirements
    click.echo(
        f"required: overshoot up to {100.0 * w.overshoot:g} %, disk margin from {w.disk_margin:g}"
        + (f", noise of a command up to {factor * w.noise:.3g} {unit}" if w.noise is not None else "")
        + (f", settling within {w.settling:g} s" if w.settling is not None else "")
    )
    own, best = tuning.compared[0], tuning.best
    if (limit := tuning.limit) and math.isfinite(limit.settling):
        name = (best or own).name
        click.echo(
            f"bound: no controller settles in less than {limit.settling:.3g} s with the commands of {name}, its "
            f"crosstalk of {100.0 * limit.crosstalk:.2g} % and the overshoot required, on the linear nominal plant "
            f"without noise; there {name} settles in {limit.tuned:.3g} s"
        )
    if limit and limit.law and (p := limit.lqg):
        click.echo(
            f"LQG of {limit.law.nstates} states: settles in {p.settling:.3g} s, overshoot {100.0 * p.overshoot:.2g} %, "
            f"disk margin {p.disk_margin:.3g}, noise {factor * p.noise:.3g} {unit}"
            + (f"; misses: {', '.join(limit.missed)}" if limit.missed else "")
        )
    for note in tuning.notes:
        click.echo(f"note: {note}")
    if best is None:
        click.echo("no controller holds all of them")
        return
    click.echo(f"best: {best.name}, settles in {best.settling:.3g} s ({own.name}: {own.settling:.3g} s)")
    click.echo(f"  {best.word_gains()}")
    for point, (gains, settling) in tuning.schedule.items():
        click.echo(f"  scheduled, {point}: {word_gains(gains)}; settles in {settling:.3g} s")


@options.command()
@click.argument("wanted")
@options.robot_option()
@click.option(
    "--out", required=True, type=options.OutputFile("commands.csv"), help="Log of the commands, or a folder for it."
)
@click.option("--map", "map_file", type=options.AnyPath(), metavar="FILE",
              help="Write them with the names and units of this mapping file, not as a log.")  # fmt: skip
def find_commands(wanted: str, robot: str, out: Path, map_file: Path | None) -> dict[str, Any]:
    """Find the commands with which the robot does what WANTED asks, and write them as a log of references.

    WANTED is a protocol such as random-motion, or a log whose references are what is wanted. With the improved robot of
    a diagnosis, the commands make up for what was found: delay, play, sag, gain.
    """
    import numpy as np

    from exodrake.analysis.feedforward import feedforward
    from exodrake.cli.logs import owner_table
    from exodrake.data.formats import find_format
    from exodrake.data.import_log import read_mapping
    from exodrake.model.display import find_display

    mapped = read_mapping(map_file) if map_file else None
    if mapped is None:
        find_format(out)
    built = exo.load_robot(robot)
    machine = built.machine
    reference = exo.from_log(wanted, built) if is_file(wanted) else exo.protocol(wanted, built)
    with options.waiting("simulating (the first run after a change compiles for half a minute)"):
        found = feedforward(built, reference)
    names = machine.log_names(machine.references)
    signals = dict(zip(names, found.commands.values.T, strict=True))
    units = {name: machine.signal[c.signal].unit for c in machine.references for name in machine.log_names([c])}
    log = exo.Log(machine.frame * np.arange(len(reference.values)), signals, units, "commands")
    options.write_files({out: log if mapped is None else owner_table(log, mapped, str(map_file))})
    shown = find_display(found.kind, machine)
    ends = [[f"{shown.factor * value:.3g} {shown.unit}" for value in one] for one in (found.before, found.after)]
    rows = list(zip(machine.channels(machine.references[0].signal), *ends, strict=True))
    options.print_table(("channel", ">RMS error if sent as wanted", ">with these commands"), rows)
    click.echo("the errors are those of the model")
    return {"kind": found.kind, "before": found.before, "after": found.after}
