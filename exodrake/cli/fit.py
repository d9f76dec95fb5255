"""`exodrake fit`: chosen parameters of a robot, fitted to its logs."""

import click

import exodrake as exo
from exodrake.cli import options
from exodrake.core.errors import InputError


@click.command()
@options.CASE
@click.option("--free", multiple=True, required=True, metavar="NAME",
              help="Parameter to fit, such as finger.kappa. Repeatable.")  # fmt: skip
@click.option("--bounds", multiple=True, metavar="NAME=LOW..HIGH",
              help="Range of one, with units or in SI. Repeatable.")  # fmt: skip
@click.option("--held-out", multiple=True, metavar="LOG", help="Log that is not fitted. Repeatable.")
@click.option("--prediction", is_flag=True, help="Fit prediction errors beside output errors.")
@options.robot_option("file")
@options.robot_changes
@click.option("--out", type=options.OutputFolder(), help="Folder for robot.yaml, fit.png and fit.json.")
@options.json_option
def command(cases, free, bounds, held_out, prediction, file, parameters, effects, parts, out, json_file) -> None:
    """Fit parameters of a robot to logs by least squares, with 90 % intervals that allow for coloured residuals.

    CASE_OR_LOG is a case folder, whose held-out logs are held out, or one or several logs. A name without channel
    frees each channel; names in one text, separated by blanks, move together. --effect puts an effect into the robot
    whose parameters may be fitted.
    """
    from rich.console import Console
    from rich.markdown import Markdown

    from exodrake.data.plot import render_png
    from exodrake.machines.robot_file import robot_text

    limits = {}
    for text in bounds:
        name, equals, span = text.partition("=")
        low, dots, high = span.partition("..")
        if not equals or not dots:
            raise InputError(f"--bounds: {text!r} is not of the form NAME=LOW..HIGH")
        limits[name.strip()] = (low, high)
    with options.waiting("fitting (the first run after a change compiles for half a minute)"):
        robot = options.change_robot(exo.load_robot(file), parameters, effects, parts)
        found = exo.fit(robot, cases[0] if len(cases) == 1 else cases, free, limits, held_out, prediction)
    console = Console(stderr=json_file == "-")
    console.print(Markdown(found.table))
    for line in (repr(found).splitlines()[-1].strip(), *(f"note: {note}" for note in found.notes)):
        console.print(line, highlight=False, soft_wrap=True)
    robot_file = robot_text(found.robot, f"{', '.join(free)} fitted to {found.case} by exodrake fit")
    files = {"robot.yaml": robot_file, "fit.png": render_png(found.plot())} if out else {}
    options.write_answer(found.to_dict(), "fit", json_file, out, files)
