"""`exodrake sweep`: many runs of a robot over its parameters, tolerances or a diagnosis, as a table."""

import click

import exodrake as exo
from exodrake.cli import options
from exodrake.core.errors import InputError


@click.command()
@click.argument("protocol", required=False, default="")
@click.option("--reference", default="", metavar="LOG", help="Follow the references of this log instead.")
@click.option("--over", multiple=True, metavar="NAME=VALUES",
              help="0.1,0.2,0.4 or 0.1:0.4:7 (low, high, count). Repeatable: a grid.")  # fmt: skip
@click.option("--robots", type=click.IntRange(1), help="So many robots within the tolerances.")
@click.option("--diagnosis", type=options.AnyPath(), metavar="FILE", help="Robots within its intervals.")
@options.robot_option("file")
@options.robot_changes
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of the draws. [0]")
@click.option("--noise", type=click.IntRange(0), help="Seed of the sensors' noise; none without it.")
@click.option("--out", type=options.OutputFolder(), help="Folder for sweep.csv, sweep.png and sweep.json.")
@options.json_option
def command(
    protocol, reference, over, robots, diagnosis, file, parameters, effects, parts, seed, noise, out, json_file
) -> None:  # fmt: skip
    """Run a robot on PROTOCOL once for each variation, and tabulate RMS from the robot's own run, peak and end."""
    import numpy as np

    from exodrake.analysis.sweep import plot_sweep
    from exodrake.core.progress import show_count
    from exodrake.core.schema import read_json
    from exodrake.data.plot import render_png

    if bool(protocol) == bool(reference) or bool(over) + bool(robots) + bool(diagnosis) != 1:
        raise InputError("wanted a protocol or --reference, and one of --over, --robots and --diagnosis")
    robot, grid = options.change_robot(exo.load_robot(file), parameters, effects, parts), {}
    for text in over:
        name, _, values = text.partition("=")
        try:
            ends = values.split(":")
            grid[name.strip()] = (
                np.linspace(float(ends[0]), float(ends[1]), int(ends[2])) if len(ends) == 3 else values.split(",")
            )
        except ValueError:
            raise InputError(f"--over: {text!r} is not NAME=VALUE,VALUE nor NAME=LOW:HIGH:COUNT") from None
    what = grid or robots or read_json(diagnosis)
    with show_count("runs", "the table is written at the end") as count:
        followed = exo.from_log(reference, robot) if reference else protocol
        found = exo.sweep(robot, what, followed, seed=seed, noise=noise, progress=count)
    numbers = found.describe().T[["mean", "std", "min", "max"]]
    rows = [(name, *(f"{x:.4g}" for x in row), found.attrs["units"].get(name, "")) for name, row in numbers.iterrows()]
    options.print_table(("", ">mean", ">std", ">least", ">largest", "unit"), rows, aside=json_file == "-")
    files = {"sweep.csv": found.to_csv(index=False), "sweep.png": render_png(plot_sweep(found))} if out else {}
    answer = {"units": found.attrs["units"], "rows": found.to_dict("records")}
    options.write_answer(answer, "sweep", json_file, out, files)
