"""What the machines of serial arms share: signals, sensors, log columns, noise, effects and their drawing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from exodrake.core.effect import Effect
from exodrake.core.machine import Column
from exodrake.core.part import Part
from exodrake.core.signal import JOINTS, NORMAL, UNIFORM, Signal
from exodrake.core.skeleton import Shape
from exodrake.effects import effects_of
from exodrake.machines.arm_defaults import TURNS, units
from exodrake.machines.urdf import Chain
from exodrake.physics.reading import sensor


def noise_std(parameter: Callable[[str], float]) -> dict[str, float]:
    """Standard deviation of the efforts of equal motions [N m]; each joint's noise comes from simulated runs."""
    return {"effort": parameter("torque.repeatability")}


def both_std(parameter: Callable[[str], float]) -> dict[str, float]:
    """Standard deviations of the efforts of equal motions [N m] and of the positions [rad]."""
    return {"position": parameter("encoder.repeatability"), **noise_std(parameter)}


def signals(unit: Mapping[str, str], *names: str) -> tuple[Signal, ...]:
    """Signals of the joints; the unit is that of the kind with which the name begins."""
    return tuple(Signal(name, unit[name.split("_")[0]], JOINTS) for name in names)


def drawn(*names: str) -> tuple[Signal, ...]:
    """Noise of the sensors of these quantities, and what may be lost of their readings."""
    noise = (Signal(f"noise_{name}", "-", JOINTS, NORMAL) for name in names)
    return (*noise, *(Signal(f"arrival_{name}", "-", JOINTS, UNIFORM) for name in names))


def columns(chain: Chain, shown: Mapping[str, str], rates: Mapping[str, str]) -> tuple[Column, ...]:
    """Log columns: kind -> signal; rates: kind -> the one whose rate it is. Kinds of mixed joints say so."""
    before, unit = "joint_" if len(set(chain.sliding)) > 1 else "", units(chain)
    return tuple(
        Column(
            before + kind, signal, required=kind != "effort_ref", unit=unit["effort"] if "effort" in kind else "",
            rate_of=before + rates[kind] if kind in rates else "",
        )
        for kind, signal in shown.items()
    )  # fmt: skip


def reading(name: str, signal: str, unit: Mapping[str, str], slot: int, frame: float, size: float, count: int) -> Part:
    """A sensor of a signal of the joints."""
    joined = (signal, f"noise_{signal}", f"arrival_{signal}", f"{signal}_read")
    return sensor(name, joined, unit[signal], slot, frame, size, count)


def effects_in(unit: Mapping[str, str], parts: tuple[Part, ...], without: tuple[str, ...]) -> tuple[Effect, ...]:
    """The effects of the parts but for some, those that are made for turning joints in the units of these."""
    own = {TURNS["position"]: unit["position"], TURNS["inertia"]: unit["inertia"], "rad/(N m)": unit["position/effort"]}
    return tuple(
        replace(e, parameters=tuple(replace(p, unit=own.get(p.unit, p.unit)) for p in e.parameters))
        for e in effects_of(parts)
        if e.id not in without
    )


def renamed(noise: dict[str, float], found: tuple[Column, ...]) -> dict[str, float]:
    """Noise by the kind of its column."""
    return {column.kind: noise[key] for column in found for key in noise if column.kind.removeprefix("joint_") == key}


def shape(robot: Any) -> Shape:
    """Geometry that a recording draws: the joints of the robot's parameters, in order."""

    def rows(*names: str) -> np.ndarray:
        return np.column_stack([robot.channels(f"arm.{name}") for name in names])

    tip = np.array([robot[f"arm.tip_{axis}"] for axis in "xyz"])
    column = next(c for c in robot.machine.columns if c.kind.endswith("position") and c.signal != "position_ref")
    origins = rows("x", "y", "z")
    return Shape(
        robot.machine.axes.joints, origins, rows("roll", "pitch", "yaw"),
        rows("axis_x", "axis_y", "axis_z"), robot.channels("arm.sliding"), np.vstack([origins[1:], tip]),
        np.array([robot["arm.base_roll"], robot["arm.base_pitch"]]), column.kind, robot.machine.compared[-1],
    )  # fmt: skip
