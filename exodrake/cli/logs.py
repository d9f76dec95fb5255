"""`exodrake show` and `compare`: a log as a moving robot, and beside a second one."""

from pathlib import Path

import click

import exodrake as exo
from exodrake.cli import options


@click.command()
@click.argument("log", type=options.AnyPath())
@options.robot_option()
@click.option("--out", type=options.AnyPath(), help="File to write [LOG with .html].")
@click.option("--estimated", is_flag=True, help="Show the estimated joint angles, not the measured ones.")
@click.option("--open", "show", is_flag=True, help="Open the file in the browser.")
def show_log(log: Path, robot: str, out: Path | None, estimated: bool, show: bool) -> None:
    """Write LOG as HTML with the moving robot, its tendons coloured by tension.

    LOG is a log file, or a folder that `exodrake simulate` wrote.
    `#t=1.5` at the end of the address stops it at that time.
    """
    from exodrake.diagrams.meshcat import recording_html

    kind = "angle_est" if estimated else ""
    file = options.log_in(log)
    html = recording_html(exo.read_log(file), exo.load_robot(robot), log.name or log.resolve().name, angles=kind)
    target = out or file.with_name(file.name.split(".")[0] + ".html")
    options.write_files({target: html})
    if show:
        click.launch(str(target))


@click.command()
@click.argument("first", type=options.AnyPath(), metavar="A")
@click.argument("second", type=options.AnyPath(), metavar="B")
@options.robot_option()
@click.option("--out", type=options.OutputFile("compare.png"), default=Path("compare.png"), show_default=True,
              help="Figure to write, or a folder for it.")  # fmt: skip
@options.json_option
def compare_logs(first: Path, second: Path, robot: str, out: Path, json_file: Path | str | None) -> None:
    """Overlay logs A and B, draw B less A below, and print RMS, mean and largest difference of each common signal.

    A and B are log files, or folders that `exodrake simulate` wrote. Where the clocks differ, B is read between its
    samples. The robot gives labels, units and colours.
    """
    from exodrake.core.plain import plain
    from exodrake.data.plot import remarks, render_png
    from exodrake.model.display import find_display
    from exodrake.model.units import find_kind

    machine = exo.load_robot(robot).machine
    one, other = (exo.read_log(options.log_in(path)) for path in (first, second))
    found = exo.compare(one, other)
    names = (first.name, second.name) if first.name != second.name else found.names
    said = remarks(found, one, machine)
    figure = one.plot(" and ".join(names), other, names, machine=machine, remarks=said, difference=True)
    rows = []
    for name, one in found.signals.items():
        kind = find_kind(name) or name
        display, channel = find_display(kind, machine, one.unit), name.removeprefix(kind).strip("_")
        cells = (f"{display.factor * x:.3g}" for x in (one.rms, one.mean, one.largest))
        rows.append((f"{kind} {channel}".rstrip(), display.unit, *cells, f"{one.at:.2f} s"))
    if json_file != "-":
        click.echo(f"B less A, {found.start:g} to {found.end:g} s; A is {found.names[0]}, B {found.names[1]}")
        options.print_table(("signal", "unit", ">RMS", ">mean", ">largest", ">at"), rows)
    for note in found.notes:
        click.secho(f"note: {note}", fg="yellow", err=True)
    printed = options.write_json(plain(found), json_file)
    options.write_files({out: render_png(figure)}, not printed)
