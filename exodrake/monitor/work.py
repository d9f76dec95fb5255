"""Simulated work drawn by a seed: grasps, random motion, holds and rests, each with new levels and paces."""

from __future__ import annotations

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.robot import Robot
from exodrake.simulation import protocols

TASKS = ("grasp", "grasp", "random", "holds", "rest")  # grasps are what the robot is for


def has_work(robot: Robot) -> bool:
    """Whether work can be drawn: the robot file has a table of grasps."""
    return bool(robot.grasps)


def work(robot: Robot, seed: int, duration: float) -> Reference:
    """References of `duration` [s]; kind, pace and levels of each task are drawn anew."""
    rng = np.random.default_rng(seed)
    frames = round(duration / robot.machine.frame)
    parts: list[np.ndarray] = []
    while sum(map(len, parts)) < frames:
        parts.append(task(robot, str(rng.choice(TASKS)), rng))
    return Reference(np.concatenate(parts)[:frames], "work")


def task(robot: Robot, kind: str, rng: np.random.Generator) -> np.ndarray:
    """References (frames, channels) of one task, 5 to 40 s long; its paces and pauses [s] are assumed."""
    if kind == "grasp":
        mode = str(rng.choice(list(robot.grasps)))
        share = rng.uniform(0.5, 1.0)
        targets = {channel: share * value for channel, value in robot.grasps[mode].items()}
        pace = {"rest": rng.uniform(0.2, 2.0), "approach": rng.uniform(0.5, 2.0), "hold": rng.uniform(1.0, 6.0)}
        return protocols.grasp(mode, robot, targets, release=rng.uniform(0.5, 2.0), **pace).tension
    seed = int(rng.integers(1 << 31))
    if kind == "random":
        return protocols.random_motion(
            robot, seed=seed, duration=rng.uniform(15.0, 40.0), fastest=rng.uniform(0.2, 1.2)
        ).tension
    if kind == "holds":
        return protocols.holds(robot, seed=seed, count=3, dwell=rng.uniform(2.0, 5.0)).tension
    lowest = [robot.limits["F_min"][channel] for channel in robot.machine.axes.tendons]
    return np.tile(lowest, (round(rng.uniform(5.0, 15.0) / robot.machine.frame), 1))
