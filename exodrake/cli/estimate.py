"""`exodrake estimate`: joint angles of a log from its tensions and strokes."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from exodrake.cli.options import AnyPath, OutputFile

if TYPE_CHECKING:
    from exodrake.estimator.gp import Zeros

BAND = "black: estimate, with a band of two standard deviations; in colour: measured"


@click.command()
@click.argument("log", type=AnyPath())
@click.option("--estimator", required=True, type=AnyPath(), help="File written by `exodrake train`.")
@click.option("--out", type=OutputFile(), default=None, help="Write the log with angle_est and angle_std columns.")
@click.option(
    "--figure", type=OutputFile(), default=None, metavar="PNG",
    help="Figure of the log with the estimated angles [beside --out].",
)  # fmt: skip
@click.option("--robot", default="", metavar="FILE", help="Robot file or machine that the estimator must belong to.")
@click.option("--as-trained", is_flag=True, help="Keep the zeros of the training, even if those of LOG have moved.")
def command(log: Path, estimator: Path, out: Path | None, figure: Path | None, robot: str, as_trained: bool) -> None:
    """Joint angles of LOG with their standard deviations, and the share of samples unlike the training sweeps.

    Tests whether the zeros of the strokes have moved since the training, as re-donning does, and corrects them. Where
    LOG has measured angles, prints the error and the share inside the 95 % interval.
    """
    from exodrake.core.errors import InputError
    from exodrake.core.files import sha256_of
    from exodrake.data.log_file import read_log, write_log
    from exodrake.data.plot import save_png
    from exodrake.estimator.file import load
    from exodrake.estimator.validate import estimate
    from exodrake.machines.library import robot_yaml

    if figure is not None and figure.suffix.lower() != ".png":
        raise InputError(f"{figure}: the figure is a PNG; its name ends in .png")
    trained = load(estimator, sha256_of(robot_yaml(robot) or robot) if robot else None)
    found = estimate(trained, read_log(log, ("tension", "stroke")), correct=not as_trained)
    if out:
        write_log(found.log, out)
        click.echo(f"{out}: {len(found.log)} rows with angle_est and angle_std")
        figure = figure or out.with_name(out.name.split(".")[0] + ".png")
    if figure:
        save_png(found.log.plot(f"{log.name}, estimated", details=[BAND]), figure)
        click.echo(f"{figure}: the log with its estimate")
    if found.zeros is not None:
        click.echo(zeros_text(found.zeros, corrected=not as_trained))
    click.echo(f"unlike the training sweeps: {100 * found.flagged:.1f} % of samples")
    if found.flagged > 0.5:
        click.echo("most samples are: other tensions, another wearer or robot? Train again before trusting the angles.")
    if found.score is None:
        click.echo("no measured angles in this log: error unknown")
        return
    for joint, rmse, coverage in zip(trained.joints, found.score.rmse, found.score.coverage, strict=True):
        click.echo(f"{joint}: RMSE {rmse:.4f} rad, {100 * coverage:.1f} % inside the 95 % interval")


def zeros_text(zeros: "Zeros", corrected: bool) -> str:
    """The zeros of a session with 95 % half widths, and what follows from them."""
    parts = zip(zeros.wires, 1e3 * zeros.shift, 1e3 * zeros.half_widths, strict=True)
    shifts = ", ".join(f"{wire} {shift:+.2f} ± {half:.2f}" for wire, shift, half in parts)
    text = f"zeros of the strokes since the training: {shifts} mm"
    if zeros.unlike:
        return f"{text}\nand more than a shift: contact, other tensions, another wearer or robot? Nothing corrected."
    if not zeros.moved:
        return f"{text}: not moved"
    done = "corrected" if corrected else "not corrected, by --as-trained"
    return f"{text}: moved, {done}. Re-donned? A changed rest posture looks the same."
