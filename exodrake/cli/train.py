"""`exodrake train`: fit the joint-angle estimator to logs and validate it under both splits."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from exodrake.cli.options import AnyPath, OutputFile

if TYPE_CHECKING:
    import numpy as np
    from rich.table import Table

    from exodrake.estimator.validate import Score


@click.command()
@click.argument("logs", nargs=-1, required=True, type=AnyPath())
@click.option("--out", required=True, type=OutputFile(), help="Estimator file to write (.npz).")
@click.option(
    "--points", default=500, show_default=True, type=click.IntRange(50, 4000), help="Training points, equispaced."
)
@click.option("--robot", default="", metavar="FILE", help="Robot file or machine whose signature to record.")
@click.option("--one-sweep-per-log", is_flag=True, help="Do not cut logs at the ramps of their tension references.")
@click.option("--seed", default=0, show_default=True, help="Of the validation's folds.")
def command(logs: tuple[Path, ...], out: Path, points: int, robot: str, one_sweep_per_log: bool, seed: int) -> None:
    """Train the joint-angle estimator on LOGS (tension, stroke and measured angles).

    Prints the error on random rows beside that on whole held-out sweeps; only the second predicts a new sweep.
    """
    from dataclasses import replace

    from rich.console import Console

    from exodrake.core.files import sha256_of
    from exodrake.data.log_file import read_log
    from exodrake.estimator.dataset import sweeps_from_logs
    from exodrake.estimator.file import save
    from exodrake.estimator.gp import condition, learn, learn_strokes
    from exodrake.estimator.validate import validate
    from exodrake.machines.library import robot_yaml

    mark = sha256_of(robot_yaml(robot) or robot) if robot else ""
    read = [read_log(path, ("tension_ref", "tension", "stroke")) for path in logs]
    sweeps = sweeps_from_logs(read, one_per_log=[log.label for log in read] if one_sweep_per_log else ())
    prior = learn(sweeps, points)
    estimator = replace(condition(prior, sweeps, points), robot=mark, strokes=learn_strokes(sweeps))
    scores = validate(prior, sweeps, points, seed)
    save(estimator, out, notes={f"{s.method}, {s.split}": [float(value) for value in s.rmse] for s in scores})
    Console().print(table(scores, estimator.joints))
    click.echo(f"{out}: {estimator.points} points of {estimator.sweeps} sweeps in {len(read)} log(s)")


def table(scores: "tuple[Score, ...]", joints: tuple[str, ...]) -> "Table":
    """Tabulate RMSE [rad] and 95 % coverage by method and split."""
    from rich.table import Table

    splits = list(dict.fromkeys(score.split for score in scores))
    drawn = Table(title="Estimator and baselines by split: a new sweep is like the right column")
    for heading in ("method", "figure"):
        drawn.add_column(heading)
    for split in splits:
        drawn.add_column(split, justify="right")
    for method in dict.fromkeys(score.method for score in scores):
        found = {score.split: score for score in scores if score.method == method}
        drawn.add_row(method, "RMSE, mean, rad", *(f"{found[split].mean_rmse:.4f}" for split in splits))
        drawn.add_row("", "/".join(joints), *(_joined(found[split].rmse, 4) for split in splits))
        drawn.add_row("", "inside 95 %", *(_joined(found[split].coverage, 2) for split in splits), end_section=True)
    return drawn


def _joined(values: "np.ndarray", digits: int) -> str:
    return " / ".join("-" if value != value else f"{value:.{digits}f}" for value in values)
