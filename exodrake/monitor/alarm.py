"""Alarm: the gap over a moving window exceeds its limit, below which healthy robots stay; and when it rose.

Limits come from simulated healthy robots at work, parameters drawn within their tolerances, no effect:

    exodrake alarm-limits --seed 21 --robots 100 --minutes 20 --write alarm_limits.yaml

The first half of the robots gives the limits' proportions: the largest gap that each channel shows in a session. The
other half gives their size: the smallest factor, one for all channels, at which none of them raises an alarm. With n
robots in that half, at most 1 - 0.05^(1/n) of healthy robots raise an alarm in such a session, with 95 % confidence and
for any distribution (Wilks' tolerance limit, Ann. Math. Stat. 12, 1941). That is 6 % for n = 50; the expected share is
1 / (n + 1). `studies.alarm_rates` tests the limits on other robots.

`rise` tells a gap that was there from the start from one that rose later, and dates it; since the alarm uses its own
limits, this does not change its rate of false alarms. It scans a channel's power before the alarm for one change:

    y_i = a + b g(t_i) + e_i        cov(e_i, e_j) = s^2 rho^|t_i - t_j| / (1 - rho^2), s and rho unknown

The errors are autocorrelated, as a gap is that follows the motion. A rise is stated where a change, averaged over rho,
has the `ODDS` against none.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.core.parallel import each
from exodrake.core.progress import counted
from exodrake.core.robot import Robot
from exodrake.core.schema import read_yaml
from exodrake.diagnosis.change_point import LEAST, ChangePoint
from exodrake.diagnosis.healthy import healthy_robot
from exodrake.machines.library import machine_folders
from exodrake.machines.robot_file import load_robot
from exodrake.monitor.gap import Gap, Reading, measured_columns, work
from exodrake.monitor.online_replay import LOOP, Channel, OnlineReplay, channels
from exodrake.simulation.simulate import simulate

LIMITS = "alarm_limits.yaml"  # in the folder of the machine


@dataclass(frozen=True)
class Alarm:
    """Alarm of a gap above its limit.

    Attributes:
        second: time since the start [s].
        channel: the replayed channel furthest above its limit; one of the closed loop only if no replay is above.
        gap: its gap [noise standard deviations].
        limit: its limit [noise standard deviations].
        above: number of channels above their limits.
        rose: times [s] between which its gap rose (90 % set); None if it was there throughout.
    """

    second: int
    channel: Channel
    gap: float
    limit: float
    above: int
    rose: tuple[float, float] | None = None


@cache
def calibration(name: str) -> dict[str, Any] | None:
    """The file of limits in the machine's folder; None of a machine that has none."""
    folder = machine_folders().get(name)
    return read_yaml(folder / LIMITS) if folder is not None and (folder / LIMITS).is_file() else None


def limits(machine: Machine) -> np.ndarray | None:
    """Limit of each channel (channels,) [noise standard deviations]; None of a machine without calibrated limits."""
    found = calibration(machine.name)
    return None if found is None else np.array([found["limits"][c.segment][c.column] for c in channels(machine)])


def judge(reading: Reading, listed: tuple[Channel, ...], limit: np.ndarray) -> Alarm | None:
    """The alarm of a reading; None below all limits, and until a whole window has passed.

    Args:
        reading: gap of each channel.
        listed: the channels.
        limit: (channels,) limits [noise standard deviations].
    """
    ratio = np.nan_to_num(reading.recent / limit)
    if not reading.full or ratio.max() <= 1.0:
        return None
    replayed = ratio * np.array([c.segment != LOOP for c in listed])
    worst = int(replayed.argmax() if replayed.max() > 1.0 else ratio.argmax())
    return Alarm(
        reading.second, listed[worst], float(reading.recent[worst]), float(limit[worst]), int((ratio > 1.0).sum())
    )


CORRELATIONS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)  # of neighbours, equally likely
# of a change: of 400 drawn steady series each with rho from 0 to 0.9, 2 % or fewer had more; of 400 that rose threefold
ODDS = 2.0  # 98 % had
TINY = 1e-6  # standard deviation below any scatter, which is then estimated alone
BEFORE = 60  # s before an alarm that are searched
SMALLEST = 1e-6  # noise variances: no logarithm of less


def rise(powers: np.ndarray, second: int, length: float = 1.0) -> tuple[float, float] | None:
    """Times [s] of the log between which a gap rose (90 % set); None without a rise.

    Args:
        powers: (n,) mean square of each of the last n seconds [noise variances], NaN if nothing was measured.
        second: end of the last one [s].
        length: of one, which is a whole number of frames [s].
    """
    known = np.isfinite(powers)
    if known.sum() < LEAST:
        return None
    times = (second + length * (np.arange(len(powers)) - len(powers) + 0.5))[known]
    logs = np.log(np.maximum(powers[known], SMALLEST))
    if np.ptp(logs) <= 0.0:
        return None
    lags, scans, without, changed = np.abs(np.subtract.outer(times, times)) / length, [], [], []
    for rho in CORRELATIONS:
        scan = ChangePoint(times, TINY**2 * rho**lags / (1.0 - rho**2), grid=1)
        none, each = scan.evidences(scan.centred(logs[:, None]))
        scans.append(scan)
        without.append(scan.volume + float(none[0]))
        changed.append(scan.volume + float(np.logaddexp.reduce(each, axis=None)))
    if np.logaddexp.reduce(changed) - np.logaddexp.reduce(without) < np.log(ODDS):
        return None
    change = scans[int(np.argmax(changed))](logs, np.random.default_rng(second))
    return (change.began[1], change.began[2]) if change.after[0] > change.before[0] else None


MINUTE = 60.0  # s
SPAN = 100_000  # seeds of robots that one seed stands for
CONFIDENCE = 0.95
LOWEST = 1.0  # noise standard deviations: no limit below, where a replay is exact


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
    proportions = np.maximum(peaks[:half].max(axis=0), LOWEST)
    return np.maximum(proportions * (peaks[half:] / proportions).max(), LOWEST)


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
