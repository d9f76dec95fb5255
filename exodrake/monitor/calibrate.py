"""Alarm limits from simulated healthy robots at work: parameters drawn within their tolerances, no effect.

    exodrake alarm-limits --seed 21 --robots 100 --minutes 20 --write alarm_limits.yaml

The first half of the robots gives the limits' proportions: the largest gap that each channel shows in a session. The
other half gives their size: the smallest factor, one for all channels, at which none of them raises an alarm. With n
robots in that half, at most 1 - 0.05^(1/n) of healthy robots raise an alarm in such a session, with 95 % confidence and
for any distribution (Wilks' tolerance limit, Ann. Math. Stat. 12, 1941). That is 6 % for n = 50; the expected share is
1 / (n + 1). `studies.alarm_rates` tests the limits on other robots.
"""

from __future__ import annotations

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.parallel import each
from exodrake.core.progress import counted
from exodrake.core.robot import Robot
from exodrake.diagnosis.healthy import healthy_robot
from exodrake.machines.robot_file import load_robot
from exodrake.monitor.channels import channels
from exodrake.monitor.gap import Gap, Reading, measured_columns
from exodrake.monitor.online_replay import OnlineReplay
from exodrake.monitor.work import work
from exodrake.simulation.simulate import simulate

MINUTE = 60.0  # s
SPAN = 100_000  # seeds of robots that one seed stands for
CONFIDENCE = 0.95
LEAST = 1.0  # noise standard deviations: no limit below, where a replay is exact


def readings(nominal: Robot, robot: Robot, noise: np.ndarray, seed: int, duration: float) -> list[Reading]:
    """Readings of whole windows that the nominal model gives of `robot` at work.

    Args:
        nominal: robot whose model is compared.
        robot: robot that writes the log.
        noise: (channels,) noise standard deviations [SI].
        seed: of work and noise.
        duration: of the work [s].
    """
    reference = work(nominal, seed, duration)
    log = simulate(robot, reference, seed=seed)
    residuals = OnlineReplay(nominal).push(reference.values, measured_columns(nominal, log), last=True)
    return [r for r in Gap(noise, nominal.machine.frame).push(residuals) if r.full]


def largest(robot: str, noise: np.ndarray, seed: int, duration: float) -> np.ndarray:
    """Largest gap of each channel (channels,) [noise standard deviations] of one healthy robot, drawn by the seed."""
    nominal = load_robot(robot)
    found = readings(nominal, healthy_robot(nominal, np.random.default_rng(seed)), noise, seed, duration)
    return np.nanmax([r.recent for r in found], axis=0)


def seeds(seed: int, robots: int) -> list[int]:
    """A seed for each robot."""
    return [SPAN * seed + k for k in range(robots)]


def limits_of(peaks: np.ndarray) -> np.ndarray:
    """Limits (channels,) from the largest gaps (robots, channels) of healthy robots [noise standard deviations].

    Proportions come from the first half of the robots, the size from the others, none of which exceeds them.
    """
    half = len(peaks) // 2
    proportions = np.maximum(peaks[:half].max(axis=0), LEAST)
    return np.maximum(proportions * (peaks[half:] / proportions).max(), LEAST)


def share_at_most(robots: int) -> float:
    """Share of healthy robots that raise an alarm, with 95 % confidence at most, where limits come from so many."""
    return 1.0 - (1.0 - CONFIDENCE) ** (1.0 / (robots - robots // 2))


def limits_text(robot: Robot, limits: np.ndarray, seed: int, robots: int, duration: float) -> str:
    """The file of limits (channels,) [noise standard deviations]; duration [s]."""
    import yaml

    listed: dict[str, dict[str, float]] = {}
    for channel, limit in zip(channels(robot.machine), limits):
        listed.setdefault(channel.segment, {})[channel.column] = float(f"{limit:.4g}")
    options = f"--robot {robot.machine.name} --seed {seed} --robots {robots} --minutes {duration / MINUTE:g}"
    head = (
        f"# gaps over 10 s [noise standard deviations] above which the alarm is raised; made by\n"
        f"#   exodrake alarm-limits {options}\n"
    )
    return head + yaml.safe_dump({"robots": robots, "minutes": duration / MINUTE, "limits": listed}, sort_keys=False)


def peaks_of(robot: str, noise: np.ndarray, seed: int, robots: int, duration: float, **where: object) -> np.ndarray:
    """Largest gaps (robots, channels) [noise standard deviations] of healthy robots, in the order of their seeds."""
    found: dict[int, np.ndarray] = {}
    tasks = ((robot, noise, own, duration) for own in seeds(seed, robots))
    with counted("robots at work", "none of it is kept") as count:
        for item in each(largest, tasks, **where):  # pyright: ignore[reportArgumentType]
            if item.value is None:
                raise InputError(f"robot {item.number}: {item.reason}")
            found[item.number] = item.value
            count(len(found), 0, robots)
    return np.array([found[k] for k in range(robots)])
