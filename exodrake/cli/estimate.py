"""`exodrake estimate`: joint angles of a log from its tensions and strokes."""

from pathlib import Path

import click


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--estimator", required=True, type=click.Path(path_type=Path), help="File written by `exodrake train`.")
@click.option(
    "--out", type=click.Path(path_type=Path), default=None, help="Write the log with angle_est and angle_std columns."
)
@click.option("--robot", type=click.Path(path_type=Path), default=None, help="Robot file the estimator must belong to.")
def command(log: Path, estimator: Path, out: Path | None, robot: Path | None) -> None:
    """Joint angles of LOG with their standard deviations, and the share of samples unlike the training sweeps.

    Where LOG has measured angles, prints the error and the share inside the 95 % interval.
    """
    from exodrake.data.log_file import read_log, write_log
    from exodrake.estimator.file import load, signature
    from exodrake.estimator.validate import estimate

    trained = load(estimator, signature(robot) if robot else None)
    table = read_log(log)
    estimated, flagged, score = estimate(trained, table)
    if out:
        write_log(estimated, out)
        click.echo(f"{out}: {len(table)} rows with angle_est and angle_std")
    click.echo(f"unlike the training sweeps: {100 * flagged:.1f} % of samples")
    if flagged > 0.5:
        click.echo("most samples are: re-donned, or another wearer or robot? Train again before trusting the angles.")
    if score is None:
        click.echo("no measured angles in this log: error unknown")
        return
    for joint, rmse, coverage in zip(trained.joints, score.rmse, score.coverage, strict=True):
        click.echo(f"{joint}: RMSE {rmse:.4f} rad, {100 * coverage:.1f} % inside the 95 % interval")
