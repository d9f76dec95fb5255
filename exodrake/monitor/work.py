"""Simulated work drawn by a seed: grasps, random motion, holds and rests, each with new levels and paces."""

from __future__ import annotations

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.robot import Robot
from exodrake.simulation import protocols
from exodrake.simulation.references import on_machine

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
