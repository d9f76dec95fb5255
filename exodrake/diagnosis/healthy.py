"""Simulated robots: healthy ones, with parameters drawn within the tolerances of the robot file, or with an effect.

The diagnosis' error rates and the limits of the monitor's alarm are measured on them.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from exodrake.data.case import Case, CaseLog
from exodrake.data.log import fill_columns
from exodrake.engine.inputs import Reference
from exodrake.model.effect import Effect, EffectParameter
from exodrake.model.robot import Robot, drawn_robot
from exodrake.simulation import protocols
from exodrake.simulation.references import reference_rows
from exodrake.simulation.simulate import run, write_log

SEEDS = 2**31  # of noise and motion


def healthy_robot(robot: Robot, rng: np.random.Generator) -> Robot:
    """The robot with each parameter that has a tolerance drawn anew, normal and clipped to its largest deviation."""
    return replace(drawn_robot(robot, rng), source="healthy")


def healthy_case(nominal: Robot, seed: int) -> Case:
    """Logs of a healthy robot: short sweeps, a chirp and holds to fit, random motion held out."""
    robot = healthy_robot(nominal, np.random.default_rng(seed))
    plan = {
        "sweeps": protocols.short_sweeps(nominal),
        "chirp": protocols.chirp(nominal),
        "holds": protocols.holds(nominal, seed=seed),
        "random": protocols.random_motion(nominal, seed=seed),
    }
    logs = [
        CaseLog(log, name, "holdout" if name == "random" else "fit", None, f"{name}.csv")
        for k, (name, reference) in enumerate(plan.items())
        for log in [write_log(run(robot, reference, seed=1000 * seed + k))]
    ]
    return Case(f"healthy {seed}", {}, tuple(logs))


def with_effect(robot: Robot, effect: Effect, rng: np.random.Generator) -> Robot:
    """The robot with an effect on a random set of channels, its parameters drawn in their plausible ranges."""
    axis = robot.machine.axes.of(effect.axis)
    channels = sorted(rng.permutation(len(axis))[: rng.integers(1, len(axis) + 1)])
    names = [axis[i] for i in channels] if effect.axis else []
    drawn = {
        p.name: {c: draw_value(p, rng) for c in names} if p.axis else draw_value(p, rng) for p in effect.parameters
    }
    return robot.splice(effect.id, drawn, names)


def draw_value(info: EffectParameter, rng: np.random.Generator) -> float:
    """A value in the plausible range of a parameter [its unit], log-uniform where a fit sees its log or inverse."""
    if not info.fitted:
        return info.initial
    if info.transform != "linear" and info.low > 0.0:
        return math.exp(rng.uniform(math.log(info.low), math.log(info.high)))
    return rng.uniform(info.low, info.high)


def follow_case(case: Case, robot: Robot, rng: np.random.Generator) -> Case:
    """The case with the logs that a robot writes on its references: the same roles, repeats, columns and gaps."""
    logs = []
    for item in case.logs:
        reference = Reference(fill_columns(reference_rows(robot.machine, item.log)), item.file)
        log = write_log(run(robot, reference, seed=int(rng.integers(SEEDS))))
        seen = [name for name in log.columns if item.log.has(name)]
        gaps = {name: np.where(np.isfinite(item.log[name]), log[name], np.nan) for name in seen}
        logs.append(replace(item, log=log.only(seen).with_signals(gaps)))
    return replace(case, robot={}, logs=tuple(logs), notes=())
