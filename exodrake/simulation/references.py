"""Protocols by name, as the command line asks for them: `caging`, `chirp:high=1.5,span=8`, or a log's references."""

from collections.abc import Callable
from dataclasses import replace
from inspect import signature
from pathlib import Path

import numpy as np

from exodrake.core.errors import InputError, argument, nearest
from exodrake.data.formats import read_log
from exodrake.data.log import ALIKE, Log
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import robot_or_default
from exodrake.model.machine import Machine
from exodrake.model.part import TENDONS
from exodrake.model.robot import Robot
from exodrake.model.units import quantity
from exodrake.simulation import protocols

SMOOTH = 0.08  # s, standard deviation of the filter of a motion whose rates are inputs, too: assumed

PROTOCOLS: dict[str, Callable[..., Reference]] = {
    function.__name__.replace("_", "-"): function
    for function in (
        protocols.sweeps, protocols.short_sweeps, protocols.maximum_tension, protocols.chirp, protocols.holds,
        protocols.steps, protocols.multisine, protocols.random_motion,
    )
}  # fmt: skip
# SI unit of the options of protocols; those without one are shares and counts
UNITS = {
    **dict.fromkeys(("rest", "approach", "hold", "release", "period", "span", "dwell", "duration", "ramp"), "s"),
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
        if key in found:
            raise InputError(f"{name}: {key!r} comes twice")
        found[key] = value
    return name.strip(), found


def protocol(text: str, robot: Robot | None = None) -> Reference:
    """The protocol or grasp mode of that name, with options: `holds:seed=3,dwell=5 s`.

    InputError with the nearest names for an unknown name or option.

    Examples:
        >>> import exodrake as exo
        >>> exo.protocol("holds:dwell=1.5 s").values.shape  # frames, tendons
        (375, 3)
    """
    robot = robot_or_default(robot)
    name, given = split_options(text)
    if name not in PROTOCOLS and name not in robot.grasps:
        there = [*robot.grasps, *PROTOCOLS]
        raise InputError(f"unknown protocol or grasp mode {name!r}{nearest(name, there)}; there are {', '.join(there)}")
    function = PROTOCOLS.get(name, protocols.grasp)
    options = {n: p.default for n, p in signature(function).parameters.items() if p.kind is p.KEYWORD_ONLY}
    for key in given:
        if key not in options:
            raise InputError(f"{name} has no option {key!r}{nearest(key, list(options))}; it has {', '.join(options)}")
    values = {key: quantity(value, UNITS.get(key, "-"), f"{name}: {key}") for key, value in given.items()}
    return on_machine(function, robot, **values) if name in PROTOCOLS else protocols.grasp(name, robot, None, **values)


def on_machine(function: Callable[..., Reference], robot: Robot, **options: float) -> Reference:
    """A protocol on any machine: tensions are shares of the highest one, other references of the span of the limits."""
    machine, limits = robot.machine, robot.machine.reference_limits
    first, *others = machine.references
    if not limits or not all(robot.limits.get(name) for name in limits):
        raise InputError(
            f"{machine.name} has no limits of {first.kind} (`reference_limits` of machine.py, `limits` of robot.yaml), "
            "so no protocol fits it; --reference LOG follows a log"
        )
    if machine.signal[first.signal].axis == TENDONS and not others:
        return function(robot, **options)
    low, high = robot.reference_limits()
    channels = machine.channels(first.signal)
    unit = replace(robot, limits={name: dict.fromkeys(channels, level) for name, level in zip(limits, (0.0, 1.0))})
    shares = function(unit, **options)
    return Reference(complete_inputs(machine, low + shares.values * (high - low)), shares.name)


def complete_inputs(machine: Machine, stated: np.ndarray, held: np.ndarray | None = None) -> np.ndarray:
    """All inputs (n, inputs) [SI] of a motion that states the first ones, (n, channels) [SI].

    `kind_start` stands where `kind_ref` begins, rates are those of the smoothed motion, further inputs stand as in
    `held` (inputs,) [SI], or at 0.
    """
    first, *others = machine.references
    rows, at = {first.kind: stated}, stated.shape[1]
    if any(column.rate_of for column in others):  # a body with mass cannot follow corners
        from scipy.ndimage import gaussian_filter1d

        rows = {first.kind: gaussian_filter1d(stated, SMOOTH / machine.frame, axis=0, mode="nearest")}
    for column in others:
        begin, at = at, at + len(machine.channels(column.signal))
        if column.rate_of:
            rows[column.kind] = np.gradient(rows[column.rate_of], machine.frame, axis=0)
            continue
        start = column.kind == first.kind.removesuffix("_ref") + "_start"
        still = stated[0] if start else np.zeros(at - begin) if held is None else held[begin:at]
        rows[column.kind] = np.tile(still, (len(stated), 1))
    return np.hstack(list(rows.values()))


def reference_rows(machine: Machine, log: Log) -> np.ndarray:
    """References of a log (n, references) [SI], in the order of `machine.references`."""
    return np.column_stack([log.array(c.kind, machine.channels(c.signal)) for c in machine.references])


def from_log(path: str | Path | Log, robot: Robot | None = None) -> Reference:
    """The references of a log or its file, as they are.

    Raises:
        InputError: for an unknown channel, a missing sample, a tension below 0, fewer than two rows, and another
            clock than the machine's.

    Examples:
        >>> import exodrake as exo
        >>> exo.write_log(exo.simulate(exo.load_robot(), "caging"), "mine.csv")
        >>> from_log("mine.csv").values.shape
        (275, 3)
    """
    machine = robot_or_default(robot).machine
    log = path if isinstance(path, Log) else read_log(argument("path", path, str, Path, Log))
    for column in machine.references:
        signal, channels = machine.signal[column.signal], machine.channels(column.signal)
        for channel in log.names(column.kind):
            if channel not in channels:
                known = f"{machine.name} has {', '.join(channels)}"
                raise InputError(f"{log.label}: {column.kind} of an unknown channel {channel!r}; {known}")
        values = log.array(column.kind, channels)
        low, wanted = (0.0, "0 or more") if signal.axis == TENDONS and signal.unit == "N" else (-np.inf, "a number")
        for row, k in np.argwhere(~(np.isfinite(values) & (values >= low)))[:1]:
            what = "is missing" if np.isnan(values[row, k]) else f"is {values[row, k]:g} {signal.unit}"
            raise InputError(f"{log.label}: {column.kind}_{channels[k]} {what} in row {row + 2}, wanted {wanted}")
    if len(log) < 2 or np.abs(np.diff(log.time) - machine.frame).max() > ALIKE:
        raise InputError(f"{log.label}: not two rows or more, {machine.frame:g} s apart; see exodrake.regularise")
    return Reference(reference_rows(machine, log), Path(log.label).name.split(".")[0])
