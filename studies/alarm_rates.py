"""Error rates of the alarm: on healthy robots that its limits were not made from, and on robots with one effect.

python -m studies.alarm_rates healthy --seed 22 --robots 60      # share that raises an alarm in 20 minutes
python -m studies.alarm_rates effects --seed 23 --robots 3       # share of effects that do, at typical values
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import click
import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.diagnosis.healthy import healthy_robot
from exodrake.machines.robot_file import load_robot
from exodrake.monitor.alarm import MINUTE, SPAN, Alarm, judge, limits, readings, seeds
from exodrake.monitor.gap import noise_std
from exodrake.monitor.online_replay import channels
from studies.page_text import share

SOON, LATE = 1.0, 20.0  # minutes


def first_alarm(nominal: Robot, robot: Robot, noise: np.ndarray, seed: int, duration: float) -> Alarm | None:
    """The first alarm of a robot at work; arguments as of `calibrate.readings`."""
    listed, limit = channels(nominal.machine), limits(nominal.machine)
    if limit is None:
        raise InputError(f"{nominal.source}: {nominal.machine.name} has no calibrated limits")
    found = (judge(r, listed, limit) for r in readings(nominal, robot, noise, seed, duration))
    return next((alarm for alarm in found if alarm), None)


def shown(alarm: Alarm | None) -> str:
    """An alarm in short."""
    if alarm is None:
        return "no alarm"
    return (
        f"{alarm.second} s, {alarm.channel.segment} {alarm.channel.column}, {alarm.gap / alarm.limit:.2f} of the limit"
    )


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
    noise, hits = noise_std(nominal), 0
    for k, own in enumerate(seeds(seed, robots)):
        robot = healthy_robot(nominal, np.random.default_rng(own))
        alarm = first_alarm(nominal, robot, noise, own, minutes * MINUTE)
        hits += alarm is not None
        if alarm or k % 10 == 9:
            click.echo(f"robot {k}: {shown(alarm)}; {time.process_time():.0f} s of CPU")
    click.echo(f"false alarms in {minutes:g} min: {share(hits, robots)}")


@dataclass(frozen=True)
class Found:
    """Robots with one effect: how many raised an alarm soon, how many late or soon, and one first alarm."""

    soon: int
    late: int
    alarm: Alarm | None


def tried(nominal: Robot, noise: np.ndarray, effect: str, seed: int, robots: int) -> Found:
    """Healthy robots with an effect of typical size on all its channels.

    The long run is made only where the short one raised nothing.
    """
    soon, late, example = 0, 0, None
    for own in range(seed, seed + robots):
        robot = healthy_robot(nominal, np.random.default_rng(own)).splice(effect)
        alarm = first_alarm(nominal, robot, noise, own, SOON * MINUTE)
        soon += alarm is not None
        alarm = alarm or first_alarm(nominal, robot, noise, own, LATE * MINUTE)
        late, example = late + (alarm is not None), example or alarm
    return Found(soon, late, example)


@main.command()
@click.option("--seed", default=23, show_default=True)
@click.option("--robots", default=3, show_default=True, help="Robots for each effect.")
def effects(seed: int, robots: int) -> None:
    """Count robots with one effect of typical size that raise an alarm."""
    nominal = load_robot()
    noise, total = noise_std(nominal), []
    click.echo(f"| effect | within {SOON:g} min | within {LATE:g} min | first alarm |\n|---|---|---|---|")
    for k, effect in enumerate(nominal.machine.effects):
        found = tried(nominal, noise, effect.id, SPAN * seed + 100 * k, robots)
        total.append(found)
        click.echo(f"| `{effect.id}` | {found.soon}/{robots} | {found.late}/{robots} | {shown(found.alarm)} |")
    runs = robots * len(total)
    click.echo(f"\nwithin {SOON:g} min: {share(sum(f.soon for f in total), runs)}")
    click.echo(f"within {LATE:g} min: {share(sum(f.late for f in total), runs)}; {time.process_time():.0f} s of CPU")


if __name__ == "__main__":
    main()
