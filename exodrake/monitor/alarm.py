"""The gap of a watched robot, and the alarm where it exceeds what healthy robots show (`docs/watch.md`).

The gap is the RMS of each channel's residuals in noise standard deviations, over a moving window and since the start.
Squares are summed by the second, so the gap does not depend on the pieces in which the log arrives.
"""

from collections import deque
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.parallel import each
from exodrake.core.progress import show_count
from exodrake.core.schema import read_yaml
from exodrake.data.log import Log
from exodrake.diagnosis.change_point import LEAST, ChangePoint
from exodrake.diagnosis.noise import sensor_noise_std
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import load_robot, machine_folders
from exodrake.model.machine import Machine
from exodrake.model.robot import Robot, drawn_robot
from exodrake.simulation import protocols
from exodrake.simulation.segments import LOOP, Channel, OnlineReplay, list_channels
from exodrake.simulation.simulate import simulate

LIMITS = "alarm_limits.yaml"  # in the folder of the machine
WINDOW = 10  # s
SKIP = 3  # s at the start that are not counted: the model starts at rest, the robot may not
PRESENT = 0.5  # share of a window's samples that must be there
OWN = 120.0  # s of the robot's own work from which the noise is measured
CLIP = 1e4  # noise standard deviations at which residuals are clipped, as in `diagnosis.problem`
BEFORE = 60  # s before an alarm that are searched for a rise
CORRELATIONS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)  # of neighbours, equally likely
# of a change: of 400 drawn steady series each with rho from 0 to 0.9, 2 % or fewer had more; of 400 that rose threefold
ODDS = 2.0  # 98 % had
TINY = 1e-6  # standard deviation below any scatter, which is then estimated alone
SMALLEST = 1e-6  # noise variances: no logarithm of less
MINUTE = 60.0  # s
SPAN = 100_000  # seeds of robots that one seed stands for
CONFIDENCE = 0.95
LOWEST = 1.0  # noise standard deviations: no limit below, where a replay is exact


def draw_work(robot: Robot, seed: int, duration: float) -> Reference:
    """References of `duration` [s] of grasps, random motion, holds and rests; paces and pauses [s] are assumed."""
    rng = np.random.default_rng(seed)
    # grasps are drawn as often as two others, where the robot file has any
    tasks = (*(("grasp", "grasp") if robot.grasps else ()), "random", "holds", "rest")
    frames, parts = round(duration / robot.machine.frame), []
    while sum(map(len, parts)) < frames:
        task = str(rng.choice(tasks))
        if task == "grasp":
            mode, share = str(rng.choice(list(robot.grasps))), rng.uniform(0.5, 1.0)
            targets = {channel: share * value for channel, value in robot.grasps[mode].items()}
            pace = {"rest": rng.uniform(0.2, 2.0), "approach": rng.uniform(0.5, 2.0), "hold": rng.uniform(1.0, 6.0)}
            parts.append(protocols.grasp(mode, robot, targets, release=rng.uniform(0.5, 2.0), **pace).values)
            continue
        own = int(rng.integers(1 << 31))
        if task == "random":
            options = {"duration": rng.uniform(15.0, 40.0), "fastest": rng.uniform(0.2, 1.2)}
            made = protocols.on_machine(protocols.random_motion, robot, seed=own, **options)
        elif task == "holds":
            made = protocols.on_machine(protocols.holds, robot, seed=own, count=3, dwell=rng.uniform(2.0, 5.0))
        else:
            made = protocols.on_machine(rest, robot, duration=rng.uniform(5.0, 15.0))
        parts.append(made.values)
    return Reference(np.concatenate(parts)[:frames], "work")


def rest(robot: Robot, *, duration: float) -> Reference:
    """The lowest references for `duration` [s]."""
    return Reference(np.tile(robot.reference_limits()[0], (round(duration / robot.machine.frame), 1)), "rest")


def replay_log(nominal: Robot, reference: Reference, log: Log) -> np.ndarray:
    """Residuals (n, channels) [SI] that the nominal model leaves of a log that has all compared columns."""
    columns = [c.column for c in list_channels(nominal.machine) if c.segment == LOOP]
    return OnlineReplay(nominal).push(reference.values, np.column_stack([log[c] for c in columns]), last=True)


def measure_noise(robot: Robot) -> np.ndarray:
    """Noise standard deviation of each channel (channels,) [SI].

    It is what a log of this very robot shows, its sensors' noise and rounding gone through the replays; at least what
    the sensors' parameters say. A machine whose work cannot be drawn has those of the sensors only.
    """
    machine, sensors = robot.machine, sensor_noise_std(robot)
    kinds = [c.kind for c in list_channels(machine)]
    if missing := set(kinds) - set(sensors):
        raise InputError(f"{robot.source}: {machine.name} states no noise of {', '.join(sorted(missing))}")
    least = np.array([sensors[kind] for kind in kinds])
    if not machine.reference_limits or not all(robot.limits.get(name) for name in machine.reference_limits):
        return least  # work needs limits of the reference
    reference = draw_work(robot, 0, OWN)
    own = replay_log(robot, reference, simulate(robot, reference, seed=0))
    return np.maximum(np.sqrt(np.nanmean(own[round(SKIP / machine.frame) :] ** 2, axis=0)), least)


class Reading(NamedTuple):
    """The gap at the end of a second."""

    second: int  # time since the start, skipped parts included [s]
    recent: np.ndarray  # (channels,) RMS of the last window [noise standard deviations], NaN if too few samples
    overall: np.ndarray  # (channels,) RMS since the start [noise standard deviations]
    full: bool  # whether a whole window has passed
    power: np.ndarray  # (channels,) mean square of the second alone [noise variances], NaN if nothing was measured


class Gap:
    """Residuals -> a `Reading` for every second that is complete, or the whole number of frames next to a second."""

    def __init__(self, noise: np.ndarray, frame: float) -> None:
        self.noise, self.second = noise, max(round(1.0 / frame), 1)
        self.length = self.second * frame  # s
        self.skip, blocks = round(SKIP / self.length), max(round(WINDOW / self.length), 1)
        self.rest = np.zeros((0, len(noise)))
        self.window: deque[np.ndarray] = deque(maxlen=blocks)  # sums of squares, and numbers of samples
        self.total, self.done = np.zeros((2, len(noise))), 0

    def push(self, residuals: np.ndarray) -> list[Reading]:
        """Takes residuals (n, channels) [SI]; returns the readings that they complete."""
        self.rest = np.concatenate([self.rest, residuals])
        found = []
        while len(self.rest) >= self.second:
            rows = np.clip(self.rest[: self.second] / self.noise, -CLIP, CLIP)
            self.rest = self.rest[self.second :]
            self.done += 1
            if self.done <= self.skip:
                continue
            own = np.array([np.nansum(rows**2, axis=0), np.isfinite(rows).sum(axis=0)])
            self.window.append(own)
            self.total = self.total + own
            power, count = np.sum(self.window, axis=0)
            enough = count >= PRESENT * self.second * len(self.window)
            with np.errstate(invalid="ignore", divide="ignore"):  # NaN where nothing was measured
                recent, overall = np.sqrt(power / np.where(enough, count, np.nan)), np.sqrt(np.divide(*self.total))
                full, now = len(self.window) == self.window.maxlen, np.divide(*own)
            found.append(Reading(round(self.done * self.length), recent, overall, full, now))
        return found


class Alarm(NamedTuple):
    """Alarm of a gap above its limit."""

    second: int  # time since the start [s]
    channel: Channel  # the replayed one furthest above its limit; one of the closed loop only if no replay is above
    gap: float  # [noise standard deviations]
    limit: float  # [noise standard deviations]
    above: int  # number of channels above their limits
    rose: tuple[float, float] | None = None  # times [s] between which the gap rose (90 % set); None: there throughout


@cache
def read_calibration(name: str) -> dict[str, Any] | None:
    """The file of limits in the machine's folder; None of a machine that has none."""
    folder = machine_folders().get(name)
    return read_yaml(folder / LIMITS) if folder is not None and (folder / LIMITS).is_file() else None


def read_limits(machine: Machine) -> np.ndarray | None:
    """Limit of each channel (channels,) [noise standard deviations]; None of a machine without calibrated limits."""
    found = read_calibration(machine.name)
    return None if found is None else np.array([found["limits"][c.segment][c.column] for c in list_channels(machine)])


def judge(reading: Reading, listed: tuple[Channel, ...], limit: np.ndarray) -> Alarm | None:
    """The alarm of a reading of some channels with limits (channels,); None below all and before a whole window."""
    ratio = np.nan_to_num(reading.recent / limit)
    if not reading.full or ratio.max() <= 1.0:
        return None
    replayed = ratio * np.array([c.segment != LOOP for c in listed])
    k = int(replayed.argmax() if replayed.max() > 1.0 else ratio.argmax())
    return Alarm(reading.second, listed[k], float(reading.recent[k]), float(limit[k]), int((ratio > 1.0).sum()))


def date_rise(powers: np.ndarray, second: int, length: float = 1.0) -> tuple[float, float] | None:
    """Times [s] of the log between which a gap rose (90 % set); None without a rise: it was there from the start.

    The logarithm of a channel's power is scanned for one change, averaged over rho, since a gap follows the motion:

        y_i = a + b g(t_i) + e_i        cov(e_i, e_j) = s^2 rho^|t_i - t_j| / (1 - rho^2), s and rho unknown

    powers: (n,) mean square of each of the last n seconds up to `second` [noise variances], NaN if nothing was
    measured; of `length` [s] each, a whole number of frames.
    """
    known = np.isfinite(powers)
    times = (second + length * (np.arange(len(powers)) - len(powers) + 0.5))[known]
    logs = np.log(np.maximum(powers[known], SMALLEST))
    if len(logs) < LEAST or np.ptp(logs) <= 0.0:
        return None
    lags, scans, evidence = np.abs(np.subtract.outer(times, times)) / length, [], []
    for rho in CORRELATIONS:
        scan = ChangePoint(times, TINY**2 * rho**lags / (1.0 - rho**2), grid=1)
        none, one = scan.evidences(scan.centre(logs[:, None]))
        scans.append(scan)
        evidence.append([scan.volume + float(none[0]), scan.volume + float(np.logaddexp.reduce(one, axis=None))])
    without, changed = np.logaddexp.reduce(evidence)
    if changed - without < np.log(ODDS):
        return None
    change = scans[int(np.argmax(np.array(evidence)[:, 1]))](logs, np.random.default_rng(second))
    return (change.began[1], change.began[2]) if change.after[0] > change.before[0] else None


def read_work(nominal: Robot, robot: Robot, noise: np.ndarray, seed: int, duration: float) -> list[Reading]:
    """Readings of whole windows, by the nominal model and `noise` (channels,) [SI], of a robot at work [s]."""
    reference = draw_work(nominal, seed, duration)
    residuals = replay_log(nominal, reference, simulate(robot, reference, seed=seed))
    return [r for r in Gap(noise, nominal.machine.frame).push(residuals) if r.full]


def measure_peaks(robot: str, noise: np.ndarray, seed: int, duration: float) -> np.ndarray:
    """Largest gap of each channel (channels,) [noise standard deviations] of one healthy robot, drawn by the seed."""
    nominal = load_robot(robot)
    found = read_work(nominal, drawn_robot(nominal, np.random.default_rng(seed)), noise, seed, duration)
    return np.nanmax([r.recent for r in found], axis=0)


def measure_all_peaks(
    robot: str, noise: np.ndarray, seed: int, robots: int, duration: float, **where: object
) -> np.ndarray:
    """Largest gaps (robots, channels) [noise standard deviations] of healthy robots, in the order of their seeds."""
    found: dict[int, np.ndarray] = {}
    tasks = ((robot, noise, SPAN * seed + k, duration) for k in range(robots))
    with show_count("robots at work", "none of it is kept") as count:
        for item in each(measure_peaks, tasks, **where):  # pyright: ignore[reportArgumentType]
            if item.value is None:
                raise InputError(f"robot {item.number}: {item.reason}")
            found[item.number] = item.value
            count(len(found), 0, robots)
    return np.array([found[k] for k in range(robots)])


def choose_limits(peaks: np.ndarray) -> np.ndarray:
    """Limits (channels,) from the largest gaps (robots, channels) of healthy robots [noise standard deviations].

    Proportions come from the first half of the robots. The size is the smallest at which none of the others, that is n,
    raises an alarm: at most 1 - 0.05^(1/n) of healthy robots then do, with 95 % confidence and for any distribution
    (Wilks' tolerance limit, Ann. Math. Stat. 12, 1941); the expected share is 1 / (n + 1).
    """
    half = len(peaks) // 2
    proportions = np.maximum(peaks[:half].max(axis=0), LOWEST)
    return np.maximum(proportions * (peaks[half:] / proportions).max(), LOWEST)


def share_at_most(robots: int) -> float:
    """Share of healthy robots that raise an alarm, with 95 % confidence at most, where limits come from so many."""
    return 1.0 - (1.0 - CONFIDENCE) ** (1.0 / (robots - robots // 2))
