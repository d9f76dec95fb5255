"""The growing gap: RMS of each channel in noise standard deviations, over a moving window and since the start.

Squares are summed second by second from the log's start, so the gap does not depend on the pieces in which the log
arrives. The noise is that of the robot's own work: grasps, random motion, holds and rests, drawn by a seed.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.data.log import Log
from exodrake.diagnosis.noise import sensor_noise_std
from exodrake.monitor.online_replay import OnlineReplay, channels, compared_columns
from exodrake.simulation import protocols
from exodrake.simulation.references import on_machine
from exodrake.simulation.simulate import simulate

TASKS = ("random", "holds", "rest")
GRASPS = ("grasp", "grasp")  # drawn as often as two others, where the robot file has grasps


def has_work(robot: Robot) -> bool:
    """Whether work can be drawn: the robot file states limits of the reference."""
    return bool(robot.machine.reference_limits) and all(robot.limits.get(n) for n in robot.machine.reference_limits)


def work(robot: Robot, seed: int, duration: float) -> Reference:
    """References of `duration` [s]; kind, pace and levels of each task are drawn anew."""
    rng = np.random.default_rng(seed)
    frames, tasks = round(duration / robot.machine.frame), (*(GRASPS if robot.grasps else ()), *TASKS)
    parts: list[np.ndarray] = []
    while sum(map(len, parts)) < frames:
        parts.append(task(robot, str(rng.choice(tasks)), rng))
    return Reference(np.concatenate(parts)[:frames], "work")


def task(robot: Robot, kind: str, rng: np.random.Generator) -> np.ndarray:
    """References (frames, channels) of one task, 5 to 40 s long; its paces and pauses [s] are assumed."""
    if kind == "grasp":
        mode = str(rng.choice(list(robot.grasps)))
        share = rng.uniform(0.5, 1.0)
        targets = {channel: share * value for channel, value in robot.grasps[mode].items()}
        pace = {"rest": rng.uniform(0.2, 2.0), "approach": rng.uniform(0.5, 2.0), "hold": rng.uniform(1.0, 6.0)}
        return protocols.grasp(mode, robot, targets, release=rng.uniform(0.5, 2.0), **pace).values
    seed = int(rng.integers(1 << 31))
    if kind == "random":
        options = {"duration": rng.uniform(15.0, 40.0), "fastest": rng.uniform(0.2, 1.2)}
        return on_machine(protocols.random_motion, robot, seed=seed, **options).values
    if kind == "holds":
        return on_machine(protocols.holds, robot, seed=seed, count=3, dwell=rng.uniform(2.0, 5.0)).values
    return on_machine(rest, robot, duration=rng.uniform(5.0, 15.0)).values


def rest(robot: Robot, *, duration: float) -> Reference:
    """The lowest references for `duration` [s]."""
    return Reference(np.tile(robot.reference_limits()[0], (round(duration / robot.machine.frame), 1)), "rest")


WINDOW = 10  # s
SKIP = 3  # s at the start that are not counted: the model starts at rest, the robot may not
PRESENT = 0.5  # share of a window's samples that must be there
OWN = 120.0  # s of the robot's own work from which the noise is measured
CLIP = 1e4  # noise standard deviations at which residuals are clipped, as in `diagnosis.problem`


def measured_columns(robot: Robot, log: Log) -> np.ndarray:
    """Compared columns (n, columns) of a log that has them all [SI]."""
    return np.column_stack([log[f"{kind}_{channel}"] for kind, channel in compared_columns(robot.machine)])


def noise_std(robot: Robot) -> np.ndarray:
    """Noise standard deviation of each channel (channels,) [SI].

    It is what a log of this very robot shows, its sensors' noise and rounding gone through the replays; at least what
    the sensors' parameters say. A machine whose work cannot be drawn has those of the sensors only.
    """
    listed, sensors = channels(robot.machine), sensor_noise_std(robot)
    if missing := {c.kind for c in listed} - set(sensors):
        raise InputError(f"{robot.source}: {robot.machine.name} states no noise of {', '.join(sorted(missing))}")
    least = np.array([sensors[c.kind] for c in listed])
    if not has_work(robot):
        return least
    reference = work(robot, 0, OWN)
    log = simulate(robot, reference, seed=0)
    own = OnlineReplay(robot).push(reference.values, measured_columns(robot, log), last=True)
    return np.maximum(np.sqrt(np.nanmean(own[round(SKIP / robot.machine.frame) :] ** 2, axis=0)), least)


@dataclass(frozen=True)
class Reading:
    """The gap at the end of a second.

    Attributes:
        second: time since the start, skipped parts included [s].
        recent: (channels,) RMS of the last window [noise standard deviations], NaN if too few samples.
        overall: (channels,) RMS since the start [noise standard deviations].
        full: whether a whole window has passed.
        power: (channels,) mean square of the second alone [noise variances], NaN if nothing was measured.
    """

    second: int
    recent: np.ndarray
    overall: np.ndarray
    full: bool
    power: np.ndarray


class Gap:
    """Residuals -> a `Reading` for every second that is complete, or the whole number of frames next to a second."""

    def __init__(self, noise: np.ndarray, frame: float) -> None:
        self.noise, self.second = noise, max(round(1.0 / frame), 1)
        self.length = self.second * frame  # s
        self.skip, blocks = round(SKIP / self.length), max(round(WINDOW / self.length), 1)
        self.rest = np.zeros((0, len(noise)))
        self.window: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=blocks)
        self.power, self.count, self.done = np.zeros(len(noise)), np.zeros(len(noise)), 0

    def push(self, residuals: np.ndarray) -> list[Reading]:
        """Takes residuals (n, channels) [SI]; returns the readings that they complete."""
        self.rest = np.concatenate([self.rest, residuals])
        found = []
        while len(self.rest) >= self.second:
            rows, self.rest = self.rest[: self.second], self.rest[self.second :]
            self.done += 1
            if self.done > self.skip:
                found.append(self.close(np.clip(rows / self.noise, -CLIP, CLIP)))
        return found

    def close(self, rows: np.ndarray) -> Reading:
        """The reading at the end of a second of normalised residuals (n, channels)."""
        known = np.isfinite(rows)
        self.window.append((np.sum(np.where(known, rows, 0.0) ** 2, axis=0), known.sum(axis=0)))
        power, count = (np.sum(x, axis=0) for x in zip(*self.window))
        self.power, self.count = self.power + self.window[-1][0], self.count + self.window[-1][1]
        enough = count >= PRESENT * self.second * len(self.window)
        whole, now = len(self.window) == self.window.maxlen, rms(*self.window[-1]) ** 2
        recent, overall = rms(power, np.where(enough, count, 0)), rms(self.power, self.count)
        return Reading(round(self.done * self.length), recent, overall, whole, now)


def rms(power: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Root of the mean of squares; NaN where nothing was counted."""
    return np.sqrt(np.divide(power, count, out=np.full(len(power), np.nan), where=count > 0))
