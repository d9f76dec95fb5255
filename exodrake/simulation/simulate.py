"""Runs a robot on a reference and makes the log of it, by the compiled twin or by the Drake Diagram."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.compiled.inputs import Chance, Reference, asked_width, prepared
from exodrake.compiled.run import run_compiled
from exodrake.core.errors import InputError
from exodrake.core.machine import Machine, offsets
from exodrake.core.robot import Robot
from exodrake.data.log import Log
from exodrake.simulation.delayed_samples import cubic


@dataclass(frozen=True, eq=False)
class Recording:
    """All wires of a run: `time` (n,) [s], start of each frame, and `wires` name -> (n, lanes) at the frame's end."""

    robot: Robot
    reference: Reference
    time: np.ndarray
    wires: dict[str, np.ndarray]


def record(
    robot: Robot,
    reference: Reference,
    seed: int | None = 0,
    quantisation: bool = True,
    engine: str = "compiled",
    substeps: int = 1,
) -> Recording:
    """Runs a robot on a reference and returns all its wires.

    Args:
        seed: of the noise; None runs without. quantisation: whether readings are rounded.
        engine: "compiled" or "drake": the same numbers to the last bit. substeps: plant ticks per 2 ms slot.
    """
    machine, frames = robot.machine, len(reference.tension)
    if reference.tension.shape[1] != (asked := asked_width(machine)):
        raise InputError(f"{reference.name}: {reference.tension.shape[1]} references, {machine.name} has {asked}")
    chance = Chance.draw(frames, seed, machine)
    values = prepared(robot, quantisation)
    if engine not in ("compiled", "drake"):
        raise InputError(f"unknown engine {engine!r}; there are compiled, drake")
    try:
        rows = rows_of(robot, values, reference, chance, engine, substeps)
    except ZeroDivisionError:
        raise InputError(f"{robot.source or machine.name}: a number is 0 that the equations divide by") from None
    if "mocap_lateness" in machine.wire:
        see_late(machine, rows, values[machine.index["mocap.sigma_q"]] * chance.angle)
    time = machine.frame * np.arange(frames)
    return Recording(robot, reference, time, {name: rows[:, at] for name, at in offsets(machine).items()})


def rows_of(
    robot: Robot, values: np.ndarray, reference: Reference, chance: Chance, engine: str, substeps: int
) -> np.ndarray:
    """All wires (frames, wires) at each frame's end, by the engine of that name."""
    if engine == "drake":
        from exodrake.diagrams.diagram import run_diagram

        return run_diagram(robot, values, reference, chance, substeps)
    return run_compiled(robot.machine, values, reference, chance, substeps)


def see_late(machine: Machine, rows: np.ndarray, noise: np.ndarray) -> None:
    """Late pictures replace the angles read in `rows` where motion capture is late; noise (frames, joints) [rad]."""
    at = offsets(machine)
    late, angle = rows[:, at["mocap_lateness"].start], at["angle_read"]
    if late.any():
        rows[:, angle] = cubic(rows[:, angle] - noise, np.arange(len(rows)) - late / machine.frame) + noise


def log_of(recording: Recording) -> Log:
    """The log that the robot would have written: the columns of the machine's table."""
    machine, signals, units = recording.robot.machine, {}, {}
    for column in machine.columns:
        values = recording.wires[column.wire]
        lanes = machine.lanes.of(machine.wire[column.wire].over)
        signals |= {f"{column.kind}_{lane}": values[:, i] for i, lane in enumerate(lanes)}
        units |= {f"{column.kind}_{lane}": machine.wire[column.wire].unit for lane in lanes}
    return Log(recording.time, signals, units, source=recording.reference.name)


def simulate(
    robot: Robot,
    reference: Reference,
    seed: int | None = 0,
    quantisation: bool = True,
    engine: str = "compiled",
    substeps: int = 1,
) -> Log:
    """The log of a robot asked to follow tension references; arguments as in `record`."""
    return log_of(record(robot, reference, seed, quantisation, engine, substeps))
