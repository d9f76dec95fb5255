"""Where the thresholds of `quiet` come from: healthy robots of the model itself, every number scattered by 3 %, noise and rounding on.

    python -m exodrake.diagnosis.calibrate --seed 7 --robots 40

prints the misfits of the retuned robots and their quantiles; a threshold is the quantile that leaves a false alarm rate of 2 %
(`diagnosis.md`), plus the allowance for another simulator's integration and rounding. No labelled case is read.
"""

from __future__ import annotations

import click
import numpy as np

from exodrake.case import Case, CaseLog
from exodrake.counting import counted, where_to_run
from exodrake.diagnosis.decide import misfit, worst_column
from exodrake.diagnosis.problem import make_problem
from exodrake.diagnosis.search import Ranking
from exodrake.diagrams.robot import Robot, load_robot
from exodrake.diagrams.simulate import Reference, simulate
from exodrake.identification import protocols
from exodrake.parallel import each

SCATTER, SCATTER_ANGLE, CLIP = 0.03, 0.01, 2.5  # relative; rad, for angles near 0; standard deviations
EXACT = (
    "sensor.sigma_F",
    "sensor.q_F",
    "encoder",
    "mocap",
    "controller",
    "motor.N",
    "motor.r_set",
    "tendon.presliding",
)
FALSE_ALARMS = 0.02  # diagnosis.md


def scattered(robot: Robot, rng: np.random.Generator) -> Robot:
    """A healthy robot: every number that may scatter drawn anew."""
    values = robot.values.copy()
    for i, entry in enumerate(robot.machine.entries):
        if entry.neutral is not None or entry.name.startswith(EXACT):
            continue
        draw = float(np.clip(rng.standard_normal(), -CLIP, CLIP))
        values[i] += SCATTER_ANGLE * draw if entry.name.startswith("finger.q_e") else SCATTER * draw * values[i]
    return Robot(robot.machine, values, limits=robot.limits, source="scattered")


def healthy_case(nominal: Robot, seed: int) -> Case:
    """Logs of a healthy robot: short sweeps, a chirp and holds to fit, random motion held out."""
    rng = np.random.default_rng(seed)
    robot = scattered(nominal, rng)
    plan: tuple[tuple[str, str, Reference], ...] = (
        ("sweeps", "fit", protocols.short_sweeps(nominal)),
        ("chirp", "fit", protocols.chirp(nominal)),
        ("holds", "fit", protocols.holds(nominal, seed=seed)),
        ("random", "holdout", protocols.random_motion(nominal, seed=seed)),
    )
    logs = [
        CaseLog(simulate(robot, reference, seed=1000 * seed + k), name, role, None, f"{name}.csv")
        for k, (name, role, reference) in enumerate(plan)
    ]
    return Case(f"healthy {seed}", {}, tuple(logs))


def retuned_misfits(seed: int, nominal: Robot) -> tuple[float, float]:
    """Misfit over all signals and of the worst one after retuning [floor^2]."""
    problem = make_problem(healthy_case(nominal, seed), nominal)
    ranking = Ranking(problem, lambda _: None, lambda _: False)
    found = ranking.retuned()
    return misfit(problem, found), worst_column(problem, found)


def measured(seed: int) -> tuple[float, float]:
    """What is measured on one robot, wherever it is run."""
    return retuned_misfits(seed, load_robot())


@click.command()
@click.option("--seed", default=7, show_default=True)
@click.option("--robots", default=40, show_default=True, type=click.IntRange(min=1))
@where_to_run
def main(seed: int, robots: int, jobs: int, cluster: str | None) -> None:
    """Measure the misfits of healthy robots."""
    found = {}
    with counted("measuring", "none of it is kept") as count:
        for item in each(measured, ((seed * 10_000 + k,) for k in range(robots)), jobs, cluster):
            if item.reason is not None:
                raise click.ClickException(f"robot {item.number}: {item.reason}")
            found[item.number] = item.value
            click.echo(f"robot {item.number}: {item.value[0]:.3f} over all signals, {item.value[1]:.3f} in the worst")
            count(len(found), 0, robots)
    whole, worst = np.array([found[k] for k in range(robots)]).T
    for name, values in (("quiet", whole), ("quiet_column", worst)):
        click.echo(
            f"{name}: median {np.median(values):.3f}, {1 - FALSE_ALARMS:.0%} quantile {np.quantile(values, 1 - FALSE_ALARMS):.3f}"
        )


if __name__ == "__main__":
    main()
