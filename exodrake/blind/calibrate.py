"""Thresholds of healthy robots, from robots of the reference simulator with drawn parameters and unseen motions.

    python -m exodrake.blind.calibrate --seed 7 --robots 40 --jobs 2

measures on each robot, retuned,
    quiet         the reduced chi-square over all signals [-],
    quiet_column  that of the worst signal,
    alarm         the cost by which the best effect, none of which is there, beats the retuned parameters,
and prints their medians and largest values; and, for several lengths of log that may count as one frame (`fit.py`), how
many 90 % intervals of nominal parameters cover the truth, and how far off these are.

A threshold lies above the largest value found: seen on n healthy robots, a false alarm rate is then below 3 / n with 95
% confidence (rule of three). No label but "healthy" and the parameters is read, and no practice case.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import click
import numpy as np

from exodrake.blind.case_mix import MIXES, draw_case, plan
from exodrake.blind.make import make_case
from exodrake.blind.nuisance_coverage import MEMORIES, coverage_of
from exodrake.core.parallel import each
from exodrake.core.progress import counted, where_to_run
from exodrake.diagnosis.problem import make_problem
from exodrake.diagnosis.search import Ranking
from exodrake.diagnosis.verdict import chi2, worst_column
from exodrake.machines.robot_file import load_robot

MEASURES = ("quiet", "quiet_column", "alarm")


def measured(seed: int, robots: int, index: int) -> tuple[tuple[float, ...], list[tuple[float, float]]]:
    """`MEASURES` of one healthy robot, and `coverage_of` its parameters."""
    from exodrake.data.case_folder import read_case

    drawn = plan(seed, robots, MIXES["healthy"])[index]
    with tempfile.TemporaryDirectory() as folder:
        make_case(drawn, folder)
        problem = make_problem(read_case(Path(folder) / drawn.name), load_robot())
    ranking = Ranking(problem)
    retuned = ranking.retuned()
    best = ranking.singles(consistent=True)[0][0]
    limits = chi2(problem, retuned), worst_column(problem, retuned), retuned.score - best.score
    return limits, coverage_of(ranking, retuned, draw_case(drawn).spec.parameters)


@click.command()
@click.option("--seed", default=7, show_default=True)
@click.option("--robots", default=40, show_default=True, type=click.IntRange(min=1))
@where_to_run
def main(seed: int, robots: int, jobs: int, cluster: str | None) -> None:
    """Measure what healthy robots look like."""
    found = {}
    with counted("measuring", "none of it is kept") as count:
        for item in each(measured, ((seed, robots, k) for k in range(robots)), jobs, cluster):
            if item.reason is not None:
                raise click.ClickException(f"robot {item.number}: {item.reason}")
            found[item.number] = item.value
            limits = zip(MEASURES, item.value[0], strict=True)
            click.echo(f"robot {item.number}: " + ", ".join(f"{m} {v:.4g}" for m, v in limits))
            count(len(found), 0, robots)
    for name, values in zip(MEASURES, np.array([found[k][0] for k in range(robots)]).T, strict=True):
        click.echo(f"{name}: median {np.median(values):.4g}, largest {np.max(values):.4g} of {robots}")
    for memory, (cover, error) in zip(MEMORIES, np.mean([found[k][1] for k in range(robots)], axis=0), strict=True):
        click.echo(f"{memory:g} s as one frame: {cover:.1%} of the intervals cover, error {error:.2f} prior deviations")


if __name__ == "__main__":
    main()
