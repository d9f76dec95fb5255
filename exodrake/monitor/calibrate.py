"""Where the alarm's limits come from: healthy robots of the model itself, every number scattered by 3 %, at work.

    python -m exodrake.monitor.calibrate --seed 21 --robots 100 --minutes 20 --write exodrake/monitor/limits.yaml

The first half of the robots gives the limits' proportions: the largest gap that each channel shows in a session. The
other half gives their size: the smallest factor, one for all channels, at which none of them raises an alarm. So,
whatever the law is, at most 1 - 0.05^(1/n) of healthy robots raise one in such a session, with 95 % confidence, where n
is half the robots (Wilks' tolerance limit, Ann. Math. Stat. 12, 1941): 6 % for n = 50, and 1 / (n + 1) are to be
expected. `live.check` tries the limits on other robots.
"""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from exodrake.core.parallel import each
from exodrake.core.progress import counted, where_to_run
from exodrake.core.robot import Robot
from exodrake.diagnosis.healthy import scattered
from exodrake.machines.robot_file import load_robot
from exodrake.monitor.companion import Companion, channels
from exodrake.monitor.gap import Gap, Reading, floors
from exodrake.monitor.motion import session
from exodrake.monitor.simulator import KINDS
from exodrake.simulation.simulate import simulate

MINUTE = 60.0  # s
SPAN = 100_000  # seeds of robots that one seed stands for
CONFIDENCE = 0.95
LEAST = 1.0  # floors: no limit below, where a replay is exact


def readings(nominal: Robot, robot: Robot, floor: np.ndarray, seed: int, duration: float) -> list[Reading]:
    """What the nominal robot's companion says of `robot` at work for `duration` [s]: whole windows only."""
    reference = session(nominal, seed, duration)
    log = simulate(robot, reference, seed=seed)
    measured = np.concatenate([log.array(kind) for kind in KINDS], axis=1)
    residuals = Companion(nominal).push(reference.tension, measured, last=True)
    return [r for r in Gap(floor, nominal.machine.frame).push(residuals) if r.full]


def largest(robot: str, floor: np.ndarray, seed: int, duration: float) -> np.ndarray:
    """The largest gap of each channel (24,) [floors] of one healthy robot, drawn by the seed from the nominal one."""
    nominal = load_robot(robot)
    found = readings(nominal, scattered(nominal, np.random.default_rng(seed)), floor, seed, duration)
    return np.nanmax([r.recent for r in found], axis=0)


def seeds(seed: int, robots: int) -> list[int]:
    """A seed for each robot."""
    return [SPAN * seed + k for k in range(robots)]


def limits_of(peaks: np.ndarray) -> np.ndarray:
    """Limits (channels,) [floors] from healthy robots' largest gaps (robots, channels): proportions from the first half
    of the robots, size from the others, none of which exceeds them."""
    half = len(peaks) // 2
    proportions = np.maximum(peaks[:half].max(axis=0), LEAST)
    return np.maximum(proportions * (peaks[half:] / proportions).max(), LEAST)


def share_at_most(robots: int) -> float:
    """Share of healthy robots that raise an alarm, with 95 % confidence at most, where limits come from so many."""
    return 1.0 - (1.0 - CONFIDENCE) ** (1.0 / (robots - robots // 2))


def page_of(robot: Robot, limits: np.ndarray, seed: int, robots: int, duration: float) -> str:
    """The file of limits."""
    import yaml

    listed: dict[str, dict[str, float]] = {}
    for channel, limit in zip(channels(robot), limits):
        listed.setdefault(channel.segment, {})[channel.column] = float(f"{limit:.4g}")
    head = (
        f"# gaps over 10 s [floors] above which the alarm is raised; made by\n"
        f"#   python -m exodrake.monitor.calibrate --seed {seed} --robots {robots} --minutes {duration / MINUTE:g}\n"
    )
    return head + yaml.safe_dump({"robots": robots, "minutes": duration / MINUTE, "limits": listed}, sort_keys=False)


@click.command()
@click.option("--seed", default=21, show_default=True)
@click.option("--robots", default=100, show_default=True, type=click.IntRange(min=2))
@click.option("--minutes", default=20.0, show_default=True, help="Work of each robot.")
@click.option("--robot", default="exo_index", show_default=True, help="Nominal robot: file or built-in name.")
@click.option("--write", type=click.Path(path_type=Path), default=None, help="File for the limits.")
@where_to_run
def main(
    seed: int, robots: int, minutes: float, robot: str, write: Path | None, jobs: int, cluster: str | None
) -> None:
    """Find limits that healthy robots stay below."""
    from exodrake.core.files import write_text

    nominal, found = load_robot(robot), {}
    floor = floors(nominal)
    tasks = ((robot, floor, own, minutes * MINUTE) for own in seeds(seed, robots))
    with counted("robots at work", "none of it is kept") as count:
        for item in each(largest, tasks, jobs, cluster):
            if item.value is None:
                raise click.ClickException(f"robot {item.number}: {item.reason}")
            found[item.number] = item.value
            count(len(found), 0, robots)
    peaks = np.array([found[k] for k in range(robots)])
    limits = limits_of(peaks)
    for channel, limit, column in zip(channels(nominal), limits, peaks.T):
        name = f"{channel.segment} {channel.column}"
        click.echo(f"{name:28s} median {np.median(column):7.2f}  largest {column.max():7.2f}  limit {limit:7.2f}")
    click.echo(
        f"at most {share_at_most(robots):.1%} of healthy robots raise an alarm in {minutes:g} min (95 % confidence)"
    )
    if write:
        write_text(write, page_of(nominal, limits, seed, robots, minutes * MINUTE))


if __name__ == "__main__":
    main()
