"""Robots drawn at random within the tolerances of a robot file."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from exodrake.core.errors import InputError, nearest
from exodrake.core.machine import Machine
from exodrake.core.parameter import expanded
from exodrake.core.robot import Robot


def drawn_robot(robot: Robot, rng: np.random.Generator) -> Robot:
    """The robot with each parameter that has a tolerance drawn anew, normal and clipped to its largest deviation."""
    machine, values = robot.machine, robot.values.copy()
    groups = [
        (group, n)
        for group in machine.tolerances
        for pattern in group.parameters
        for n in expanded(pattern, machine.axes)
    ]
    for (group, names), drawn in zip(groups, rng.standard_normal(len(groups)), strict=True):
        x = float(np.clip(drawn * group.prior_std, -group.max_deviation, group.max_deviation))
        for name in names.split():
            i = position(machine, name)
            values[i] = {
                "log": robot.values[i] * math.exp(x),
                "additive": robot.values[i] + x,
                "relative": robot.values[i] * (1.0 + x),
            }[group.transform]
    return replace(robot, values=values)


def drawn_deviation(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """Deviations (parameters,) [SI] of a robot drawn by `drawn_robot` from the given one; 0 without a tolerance."""
    drawn = drawn_robot(robot, rng).values
    return np.subtract(drawn, robot.values, out=np.zeros(len(drawn)), where=drawn != robot.values)


def position(machine: Machine, name: str) -> int:
    """Position of a parameter in the flat vector. Raises InputError for an unknown name."""
    if name not in machine.index:
        raise InputError(f"{machine.name}: tolerance of {name!r}{nearest(name, list(machine.index))}")
    return machine.index[name]
