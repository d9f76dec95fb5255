"""Exogenous inputs of a run: references, noise and prepared parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.core.robot import Robot
from exodrake.core.short_repr import short_repr
from exodrake.core.signal import TENDONS


@short_repr
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
class NoiseInputs:
    """Draws of one run: standard normal `tension` and `angle` noise (n, 3) and uniform `packet_arrival` (n, 3)."""

    tension: np.ndarray
    angle: np.ndarray
    packet_arrival: np.ndarray

    @staticmethod
    def draw(frames: int, seed: int | None, machine: Machine) -> NoiseInputs:
        """Seeded draws; all zero, and a packet_arrival that never wins, without a seed."""
        wires, joints = len(machine.axes.tendons), len(machine.axes.joints)
        if seed is None:
            return NoiseInputs(np.zeros((frames, wires)), np.zeros((frames, joints)), np.ones((frames, wires)))
        rng = np.random.default_rng(seed)
        normal = rng.standard_normal((frames, wires + joints))
        return NoiseInputs(
            np.ascontiguousarray(normal[:, :wires]),
            np.ascontiguousarray(normal[:, wires:]),
            rng.random((frames, wires)),
        )


NOTHING = np.zeros((0, 0))  # no fine record; no log to follow


def reference_width(machine: Machine) -> int:
    """How many references a machine takes."""
    return sum(machine.width(machine.signal[c.signal].axis) for c in machine.references)


def input_rows(machine: Machine, asked: np.ndarray, noise_inputs: NoiseInputs) -> dict[str, np.ndarray]:
    """Signals from outside, (frames, channels) [SI] each, in the order of the table.

    asked: (frames, references) in the order of `machine.asked`. Others are named `noise_...` (standard normal) or
    `packet_arrival` (uniform).
    """
    found, at = {}, 0
    for name in machine.inputs:
        axis = machine.signal[name].axis
        if name.startswith("noise_"):
            found[name] = noise_inputs.tension if axis == TENDONS else noise_inputs.angle
        elif name == "packet_arrival":
            found[name] = noise_inputs.packet_arrival
        else:
            found[name] = np.ascontiguousarray(asked[:, at : at + machine.width(axis)])
            at += machine.width(axis)
    return found


def prepared(robot: Robot, quantisation: bool = True) -> np.ndarray:
    """Parameter values (parameters,) [SI] of a run, with the resolutions at 0 if unquantised."""
    values = robot.values.copy()
    if np.isnan(values).any():
        missing = robot.machine.parameters[int(np.isnan(values).argmax())].name
        raise InputError(f"{robot.source}: number {missing} is missing")
    if not quantisation:
        for name in robot.machine.resolution:
            values[robot.machine.index[name]] = 0.0
    return values
