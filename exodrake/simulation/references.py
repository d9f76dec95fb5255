"""Protocols by name, as the command line asks for them: `caging`, `chirp:high=1.5,span=8`, or a log's references."""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature
from pathlib import Path

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.errors import InputError, nearest
from exodrake.core.robot import Robot
from exodrake.core.units import quantity
from exodrake.data.log_file import read_log
from exodrake.machines.robot_file import load_robot
from exodrake.simulation import protocols

ALIKE = 1e-6  # [s] two clocks closer than this are the same

PROTOCOLS: dict[str, Callable[..., Reference]] = {
    "sweeps": protocols.sweeps,
    "short-sweeps": protocols.short_sweeps,
    "chirp": protocols.chirp,
    "holds": protocols.holds,
    "steps": protocols.steps,
    "multisine": protocols.multisine,
    "random-motion": protocols.random_motion,
}


# SI unit of the options of protocols; those without one are shares and counts
UNITS = {
    **dict.fromkeys(("rest", "approach", "hold", "release", "period", "span", "dwell", "duration"), "s"),
    **dict.fromkeys(("low", "high", "fastest"), "Hz"),
}


def split_options(text: str) -> tuple[str, dict[str, str]]:
    """`name:a=1,b=2 mm` as the name and its values; InputError naming what is none."""
    name, _, tail = text.partition(":")
    found = {}
    for item in filter(None, tail.split(",")):
        key, equals, value = (part.strip() for part in item.partition("="))
        if not equals:
            raise InputError(f"{name}: {item!r} is not of the form name=number")
        found[key] = value
    return name.strip(), found


def options_of(function: Callable[..., Reference]) -> dict[str, float]:
    """Options of a protocol with their defaults."""
    return {n: p.default for n, p in signature(function).parameters.items() if p.kind is p.KEYWORD_ONLY}


def protocol(text: str, robot: Robot | None = None) -> Reference:
    """The protocol or grasp mode of that name, with options: `holds:seed=3,dwell=5 s`.

    InputError with the nearest names for an unknown name or option.
    """
    robot = robot or load_robot()
    name, given = split_options(text)
    if name not in PROTOCOLS and name not in robot.grasps:
        there = [*robot.grasps, *PROTOCOLS]
        raise InputError(f"unknown protocol or grasp mode {name!r}{nearest(name, there)}; there are {', '.join(there)}")
    function = PROTOCOLS.get(name, protocols.grasp)
    options = options_of(function)
    for key in given:
        if key not in options:
            raise InputError(f"{name} has no option {key!r}{nearest(key, list(options))}; it has {', '.join(options)}")
    values = {key: quantity(value, UNITS.get(key, "-"), f"{name}: {key}") for key, value in given.items()}
    return function(robot, **values) if name in PROTOCOLS else protocols.grasp(name, robot, None, **values)


def from_log(path: str | Path, robot: Robot | None = None) -> Reference:
    """The tension references of a log, as they are; InputError for an unknown wire, a missing sample, another clock."""
    robot = robot or load_robot()
    log, wires = read_log(path, required=("tension_ref",)), robot.machine.axes.tendons
    for wire in log.names("tension_ref"):
        if wire not in wires:
            raise InputError(f"{log.label}: tension_ref of an unknown wire {wire!r}; the robot has {', '.join(wires)}")
    tension = log.array("tension_ref", wires)
    for row, column in np.argwhere(~(np.isfinite(tension) & (tension >= 0.0)))[:1]:
        value = tension[row, column]
        what = "is missing" if np.isnan(value) else f"is {value:g} N"
        raise InputError(f"{log.label}: tension_ref_{wires[column]} {what} in row {row + 2}, wanted 0 or more")
    if log.dt and np.abs(np.diff(log.time) - robot.machine.frame).max() > ALIKE:
        raise InputError(f"{log.label}: rows are not {robot.machine.frame:g} s apart; see exodrake.regularise")
    return Reference(tension, Path(path).name.split(".")[0])
