"""Error rates of the alarm: on healthy robots that its limits were not made from, and on robots with one effect.

python -m studies.alarm_rates healthy --seed 22 --robots 60      # share that raises an alarm in 20 minutes
python -m studies.alarm_rates effects --seed 23 --robots 3       # share of effects that do, at typical values
"""

from __future__ import annotations

import time

import click
import numpy as np

from exodrake.core.errors import InputError
from exodrake.machines.robot_file import load_robot
from exodrake.model.robot import Robot, drawn_robot
from exodrake.monitor.alarm import MINUTE, SPAN, Alarm, judge, measure_noise, read_limits, read_work
from exodrake.simulation.segments import list_channels
from studies.page_text import share

SOON, LATE = 1.0, 20.0  # minutes


def first_alarm(nominal: Robot, robot: Robot, noise: np.ndarray, seed: int, duration: float) -> Alarm | None:
    """The first alarm of a robot at work; arguments as of `read_work`."""
    listed, limit = list_channels(nominal.machine), read_limits(nominal.machine)
    if limit is None:
        raise InputError(f"{nominal.source}: {nominal.machine.name} has no calibrated limits")
    found = (judge(reading, listed, limit) for reading in read_work(nominal, robot, noise, seed, duration))
    return next((alarm for alarm in found if alarm), None)


def describe(alarm: Alarm | None) -> str:
    """An alarm in short."""
    if alarm is None:
        return "no alarm"
    where = f"{alarm.channel.segment} {alarm.channel.column}"
    return f"{alarm.second} s, {where}, {alarm.gap / alarm.limit:.2f} of the limit"


@click.group()
def main() -> None:
    """Try the alarm on other robots than those its limits were made from."""


@main.command()
@click.option("--seed", default=22, show_default=True)
@click.option("--robots", default=60, show_default=True)
@click.option("--minutes", default=20.0, show_default=True, help="Work of each robot.")
def healthy(seed: int, robots: int, minutes: float) -> None:
    """Count healthy robots that raise an alarm."""
    nominal = load_robot()
    noise, hits = measure_noise(nominal), 0
    for k in range(robots):
        own = SPAN * seed + k
        robot = drawn_robot(nominal, np.random.default_rng(own))
        alarm = first_alarm(nominal, robot, noise, own, minutes * MINUTE)
        hits += alarm is not None
        if alarm or k % 10 == 9:
            click.echo(f"robot {k}: {describe(alarm)}; {time.process_time():.0f} s of CPU")
    click.echo(f"false alarms in {minutes:g} min: {share(hits, robots)}")


@main.command()
@click.option("--seed", default=23, show_default=True)
@click.option("--robots", default=3, show_default=True, help="Robots for each effect.")
def effects(seed: int, robots: int) -> None:
    """Count robots with one effect, of typical size on all its channels, that raise an alarm."""
    nominal, soon, late = load_robot(), 0, 0
    noise, total = measure_noise(nominal), robots * len(nominal.machine.effects)
    click.echo(f"| effect | within {SOON:g} min | within {LATE:g} min | first alarm |\n|---|---|---|---|")
    for k, effect in enumerate(nominal.machine.effects):
        early: list[Alarm] = []
        later: list[Alarm] = []
        for own in range(SPAN * seed + 100 * k, SPAN * seed + 100 * k + robots):
            robot = drawn_robot(nominal, np.random.default_rng(own)).splice(effect.id)
            if alarm := first_alarm(nominal, robot, noise, own, SOON * MINUTE):
                early.append(alarm)
            elif alarm := first_alarm(nominal, robot, noise, own, LATE * MINUTE):
                later.append(alarm)
        counts = f"{len(early)}/{robots} | {len(early) + len(later)}/{robots}"
        click.echo(f"| `{effect.id}` | {counts} | {describe(next(iter(early + later), None))} |")
        soon, late = soon + len(early), late + len(early) + len(later)
    click.echo(f"\nwithin {SOON:g} min: {share(soon, total)}")
    click.echo(f"within {LATE:g} min: {share(late, total)}; {time.process_time():.0f} s of CPU")


if __name__ == "__main__":
    main()
