"""Exogenous inputs of a run: references, noise and prepared parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.core.robot import Robot
from exodrake.core.signal import WIRES


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
