"""Runs a robot on a reference and makes the log of it, by the compiled twin or by the Drake Diagram."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.compiled.compose import compile_machine
from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.core.part import WIRES
from exodrake.core.robot import Robot
from exodrake.data.log import Log
from exodrake.simulation.delayed_samples import cubic


@dataclass(frozen=True, eq=False)
class Reference:
    """What the robot is asked to do: `tension` (n, wires) [N], one row per frame; `name` of the protocol.

    For a machine that is asked for something else: the columns of `machine.asked` side by side, in SI.
    """

    tension: np.ndarray
    name: str = "reference"

    def __post_init__(self) -> None:
        rows = np.ascontiguousarray(self.tension, dtype=float)
        if rows.ndim != 2 or not len(rows):
            raise InputError(f"{self.name}: tension references of shape {rows.shape}, wanted (frames, wires)")
        if not np.isfinite(rows).all():
            frame, wire = np.argwhere(~np.isfinite(rows))[0]
            raise InputError(f"{self.name}: tension reference of wire {wire} is not finite in frame {frame}")
        object.__setattr__(self, "tension", rows)


@dataclass(frozen=True)
class Chance:
    """Draws of one run: standard normal `tension` and `angle` noise (n, 3) and uniform `lottery` (n, 3)."""

    tension: np.ndarray
    angle: np.ndarray
    lottery: np.ndarray

    @staticmethod
    def draw(frames: int, seed: int | None, machine: Machine) -> Chance:
        """Seeded draws; all zero, and a lottery that never wins, without a seed."""
        wires, joints = len(machine.lanes.wires), len(machine.lanes.joints)
        if seed is None:
            return Chance(np.zeros((frames, wires)), np.zeros((frames, joints)), np.ones((frames, wires)))
        rng = np.random.default_rng(seed)
        normal = rng.standard_normal((frames, wires + joints))
        return Chance(
            np.ascontiguousarray(normal[:, :wires]),
            np.ascontiguousarray(normal[:, wires:]),
            rng.random((frames, wires)),
        )


@dataclass(frozen=True, eq=False)
class Recording:
    """All wires of a run: `time` (n,) [s], start of each frame, and `wires` name -> (n, lanes) at the frame's end."""

    robot: Robot
    reference: Reference
    time: np.ndarray
    wires: dict[str, np.ndarray]


NOTHING = np.zeros((0, 0))  # no fine record; no log to follow


def asked_width(machine: Machine) -> int:
    """How many references a machine takes."""
    return sum(machine.width(machine.wire[c.wire].over) for c in machine.asked)


def given_rows(machine: Machine, asked: np.ndarray, chance: Chance) -> dict[str, np.ndarray]:
    """The wires that come from outside, (frames, lanes) each, in the table's order.

    asked: (frames, references) in the order of `machine.asked`. Others are named `noise_...` (standard normal) or
    `lottery` (uniform).
    """
    found, at = {}, 0
    for name in machine.given:
        over = machine.wire[name].over
        if name.startswith("noise_"):
            found[name] = chance.tension if over == WIRES else chance.angle
        elif name == "lottery":
            found[name] = chance.lottery
        else:
            found[name] = np.ascontiguousarray(asked[:, at : at + machine.width(over)])
            at += machine.width(over)
    return found


def offsets(machine: Machine) -> dict[str, slice]:
    """Where each wire lies in the flat vector of wires."""
    found, at = {}, 0
    for wire in machine.wires:
        width = machine.width(wire.over)
        found[wire.name], at = slice(at, at + width), at + width
    return found


def state_size(machine: Machine) -> int:
    """Length of the flat state."""
    return sum(sum(machine.part_size(block)) for block in machine.blocks)


def wire_count(machine: Machine) -> int:
    """Length of the flat vector of wires."""
    return sum(machine.width(w.over) for w in machine.wires)


def prepared(robot: Robot, quantisation: bool = True) -> np.ndarray:
    """The flat numbers of a run, with the resolutions at 0 if unquantised."""
    values = robot.values.copy()
    if np.isnan(values).any():
        missing = robot.machine.entries[int(np.isnan(values).argmax())].name
        raise InputError(f"{robot.source}: number {missing} is missing")
    if not quantisation:
        for name in robot.machine.resolution:
            values[robot.machine.index[name]] = 0.0
    return values


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


def run_compiled(
    machine: Machine, values: np.ndarray, reference: Reference, chance: Chance, substeps: int
) -> np.ndarray:
    """All wires (frames, wires) at each frame's end, by the compiled twin."""
    module = compile_machine(machine)
    rows = np.zeros((len(reference.tension), wire_count(machine)))
    state, w = np.zeros(state_size(machine)), np.zeros(wire_count(machine))
    module.begin(values, state)
    given = given_rows(machine, reference.tension, chance).values()
    module.run(values, state, w, *given, machine.slot / substeps, substeps, rows, NOTHING, NOTHING)
    return rows


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
