"""Machines of one serial arm, described by the `arm` section of a robot file and a URDF file beside it; no code.

    machine: my_arm
    arm: {urdf: arm.urdf, form: inverse, frame: 0.005}          # or form: closed-loop; tip: LINK where joints branch

`inverse`: motion is measured and the effort predicted from it. `closed-loop`: references go through PD controller,
motors and forward dynamics. Parameters that the URDF states need not be in the robot file. A linear or rotary axis is
an arm of one joint.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.effect import Effect
from exodrake.core.errors import InputError
from exodrake.core.loop import Controller, Gain, Loop
from exodrake.core.machine import Column, Machine
from exodrake.core.part import Part
from exodrake.core.schema import mapping, number, text
from exodrake.core.segment import Segment
from exodrake.core.signal import JOINTS, NORMAL, UNIFORM, Axes, Signal
from exodrake.core.skeleton import Shape
from exodrake.effects import effects_of
from exodrake.machines.arm_defaults import (
    SWING,
    TURNS,
    drive_defaults,
    losses,
    middle,
    scales,
    stated,
    typical_efforts,
    units,
)
from exodrake.machines.urdf import Chain, read_urdf
from exodrake.systems import arm_drive, arm_forward, arm_inverse, gear_motor
from exodrake.systems.reading import sensor

FORMS = ("inverse", "closed-loop")
SLOWEST, TICK = 10.0, 5e-4  # s: longest frame; the plant's tick at most, so that a wrist's resonance is resolved
SECTION = mapping(
    {"urdf": text(), "form": text(FORMS), "frame": number(above=0.0, high=SLOWEST), "tip": text()}, required=("urdf",)
)
FRAME = 0.005  # s, as most recordings of arms: assumed
STEP = 0.02  # rad or m, of a reference for the analysis: assumed
CROSSTALK = ("torque.crosstalk", "encoder.crosstalk")  # not tried: joints are measured one by one
OFFSET = ("arm.offset",)  # which is `torque.offset` in inverse dynamics


def arm_machine(name: str, section: Any, folder: Path, source: str) -> Machine:
    """The machine of an `arm` section.

    Args:
        name: of the machine.
        section: content of the key `arm`.
        folder: that holds the robot file; the URDF file must lie in it.
        source: of the section, for messages.

    Raises:
        InputError: for an unknown key, and a URDF file that is absent, elsewhere or no serial arm.
    """
    section = SECTION(section, f"{source}, 'arm'")
    path = (folder / section["urdf"]).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise InputError(f"{source}: urdf {section['urdf']} lies outside the folder of the robot file")
    chain = read_urdf(path, section.get("tip", ""))
    build = inverse_machine if section.get("form", FORMS[0]) == FORMS[0] else closed_machine
    return build(name, chain, section.get("frame", FRAME))


def noise_std(parameter: Callable[[str], float]) -> dict[str, float]:
    """By how much the efforts of equal motions differ [N m]; the noise of each joint comes from simulated runs."""
    return {"effort": parameter("torque.repeatability")}


def both_std(parameter: Callable[[str], float]) -> dict[str, float]:
    """The same, and that of positions [rad]."""
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


def inverse_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in inverse-dynamics form: position, velocity and acceleration are measured, the effort is predicted."""
    unit, efforts, count = units(chain), typical_efforts(chain), len(chain.names)
    torque = reading("torque", "effort", unit, 0, frame, float(efforts.max()), count)
    parts = (arm_inverse.part(scales(efforts, unit), unit), torque)
    motion = signals(unit, "position", "velocity", "acceleration")
    shown = {**{s.name: s.name for s in motion}, "effort": "effort_read"}
    found = columns(chain, shown, {"velocity": "position", "acceleration": "velocity"})
    return Machine(
        name=name,
        axes=Axes((), chain.names),
        signals=(*motion, *drawn("effort"), *signals(unit, "effort", "effort_read")),
        parts=parts,
        inputs=(*(s.name for s in motion), "noise_effort", "arrival_effort"),
        columns=found,
        effects=effects_in(unit, parts, CROSSTALK + OFFSET),
        frame=frame,
        slots=1,
        noise=tuple(f"torque.sigma.{j}" for j in chain.names),
        resolution=tuple(f"torque.step.{j}" for j in chain.names),
        compared=(found[-1].kind,),
        noise_std=lambda parameter: renamed(noise_std(parameter), found),
        segments=(Segment("arm", found[-1].kind),),
        max_effects=4,
        reference_limits=("position_min", "position_max"),
        skeleton=shape,
        defaults=stated(chain, "arm") | losses(chain),
    )


def renamed(noise: dict[str, float], found: tuple[Column, ...]) -> dict[str, float]:
    """Noise by the kind of its column."""
    return {column.kind: noise[key] for column in found for key in noise if column.kind.removeprefix("joint_") == key}


def closed_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in closed loop: controller, motors, forward dynamics, encoders and torque sensors."""
    unit, efforts, count = units(chain), typical_efforts(chain), len(chain.names)
    slots = max(4, round(np.ceil(frame / TICK)))
    encoder = reading("encoder", "position", unit, 1, frame, SWING, count)
    torque = reading("torque", "effort", unit, 3, frame, float(efforts.max()), count)
    forward = arm_forward.part(count, 0, scales(efforts, unit), unit)
    parts = (forward, gear_motor.PART, encoder, torque, arm_drive.part(2, unit))
    given = signals(unit, "position_ref", "position_start")
    inner = signals(unit, "position", "position_read", "effort_ref", "effort", "effort_true", "effort_read")
    link = Signal("link_position", unit["position"], JOINTS)
    noises = drawn("position", "effort")
    shown = {s.name: s.name for s in given}
    shown |= {"effort_ref": "effort_ref", "position": "position_read", "effort": "effort_read"}
    found = columns(chain, shown, {})
    position, effort = found[-2].kind, found[-1].kind
    return Machine(
        name=name,
        axes=Axes((), chain.names),
        signals=(*given, *noises, *inner, link),
        parts=parts,
        inputs=(*(s.name for s in given), *(s.name for s in noises)),
        columns=found,
        effects=effects_in(unit, parts, CROSSTALK),
        frame=frame,
        slots=slots,
        noise=tuple(f"{part}.sigma.{j}" for part in ("encoder", "torque") for j in chain.names),
        resolution=tuple(f"{part}.step.{j}" for part in ("encoder", "torque") for j in chain.names),
        compared=(position, effort),
        noise_std=lambda parameter: renamed(both_std(parameter), found),
        segments=(Segment("drive", effort, (position,)), Segment("arm", position, (effort,))),
        max_effects=4,
        reference_limits=("position_min", "position_max"),
        skeleton=shape,
        loop=loop_of(chain),
        defaults=stated(chain, "arm") | losses(chain) | drive_defaults(chain, efforts, frame),
    )


def loop_of(chain: Chain) -> Loop:
    """The closed loop that `analyse` and `tune` look at."""
    gains = (Gain("drive.kp", 0.1, 10.0), Gain("drive.kd", 0.1, 10.0))
    return Loop(
        reference="position_ref", command="effort_ref", output="position", measured="position_read",
        part="drive", held="effort", gains=gains, gentle={"drive.kp": 0.5, "drive.kd": 1.0}, step=STEP,
        points={"middle": dict(zip(chain.names, middle(chain).tolist(), strict=True))},
        controllers=(Controller("PD", gains),), resolution="encoder.step", nonlinear={"arm.coulomb_friction": {}},
    )  # fmt: skip


def shape(robot: Any) -> Shape:
    """What a recording draws: the joints of the robot's parameters, in order."""

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
