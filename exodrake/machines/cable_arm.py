"""The machine of a serial arm that motors move through cables: `arm: {urdf: arm.urdf, form: cable}` in a robot file.

    position_ref -> PD controller -> A' -> motors -> cables -> arm      motor_position -> A -> controller

A log holds references, positions and efforts of the motors and, where encoders or a camera see them, positions of the
joints (`position`). The matrix A, cables and motors are `cable` in the robot file.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from exodrake.core.effect import Effect
from exodrake.core.machine import Column, Machine, Segment
from exodrake.core.mechanism import Chain
from exodrake.core.part import JOINTS, Axes, Output, Part, Signal, Task
from exodrake.effects import friction
from exodrake.machines.arm_defaults import (
    BANDWIDTH,
    SHARE,
    SPEED,
    SWING,
    drawn,
    drive_defaults,
    effects_in,
    inertias,
    joint_control,
    losses,
    mechanism,
    reading,
    scales,
    shape,
    stated,
    typical_efforts,
    units,
)
from exodrake.physics import arm, arm_drive, cable, gear_motor

RATIO = 0.05  # of joint to motor: assumed, as of small gears and capstans
RESONANCE = 2.0 * np.pi * 15.0  # rad/s of the links on their cables, motors held: assumed; 10-30 Hz are usual
REFLECTED = 0.2  # inertia of a motor over that of its links, as the joint feels it: assumed
LOSS = 1e-3  # s, of a steel cable: 5 % of critical damping at that resonance: assumed
TAUT = 2.0  # pretension in efforts of a moderate motion: assumed, so that no strand goes slack in one
SENSORS = {"position": "link_encoder", "motor_position": "encoder", "motor_effort": "torque"}  # by kind of column
SEEN = ("link_position", *list(SENSORS)[1:])  # the signals that they measure
COLUMNS = (
    Column("position", "link_position_read", required=False),
    Column("motor_effort_ref", "motor_effort_ref", required=False, unit="N m"),
    Column("motor_position", "motor_position_read"),
    Column("motor_effort", "motor_effort_read", unit="N m"),
)
SEGMENTS = (
    Segment("drive", "motor_effort", ("motor_position",)),
    Segment("cable", "motor_position", ("motor_effort",)),
    Segment("arm", "position", ("motor_position",)),
)
LEFT_OUT = ("arm.joint_compliance", "arm.rotor_inertia")  # which the cables and motors are themselves


def cable_machine(name: str, chain: Chain, slots: int, frame: float) -> Machine:
    """The machine.

    Args:
        name: of the machine.
        chain: the arm.
        slots: in a frame [s].
        frame: its period [s].
    """
    unit, efforts = units(chain), typical_efforts(chain)
    parts = parts_of(chain, unit, efforts, frame)
    rubbing = tuple(e.id for e in effects_in(unit, parts, ()) if e.id.startswith("arm.") and rubs(e))
    crosstalk = tuple(f"{sensor}.crosstalk" for sensor in SENSORS.values())
    given = (Signal("position_ref", unit["position"], JOINTS), Signal("position_start", unit["position"], JOINTS))
    noises = drawn(*SEEN)
    return Machine(
        name=name,
        axes=Axes((), chain.names),
        signals=(*given, *noises, *inner_signals(unit)),
        parts=parts,
        inputs=(*(s.name for s in given), *(s.name for s in noises)),
        columns=(*(Column(s.name, s.name) for s in given), *COLUMNS),
        effects=effects_in(unit, parts, (*crosstalk, *rubbing, *LEFT_OUT)),
        frame=frame,
        slots=max(6, slots),
        noise=tuple(f"{sensor}.sigma.{j}" for sensor in SENSORS.values() for j in chain.names),
        resolution=tuple(f"{sensor}.step.{j}" for sensor in SENSORS.values() for j in chain.names),
        compared=tuple(SENSORS),
        noise_std=lambda parameter: {kind: parameter(f"{sensor}.repeatability") for kind, sensor in SENSORS.items()},
        segments=SEGMENTS,
        max_effects=6,
        reference_limits=("position_min", "position_max"),
        skeleton=shape,
        mechanism=mechanism,
        loop=joint_control(chain, {}),
        defaults=defaults_of(chain, efforts, frame),
    )  # fmt: skip


def rubs(effect: Effect) -> bool:
    """Whether an effect is one of friction, by its laws."""
    return all(function.__module__ == friction.__name__ for function in effect.at.values())


def inner_signals(unit: dict[str, str]) -> tuple[Signal, ...]:
    """Signals between the parts, of joints and of motors."""
    joint = {"position": "position", "position_read": "position", "link_position": "position", "effort_ref": "effort"}
    joint |= {"link_position_read": "position", "effort_true": "effort", "link_start": "position"}
    motor = dict.fromkeys(("motor_start", "motor_position", "motor_position_read"), "rad")
    motor |= dict.fromkeys(("motor_effort_ref", "motor_effort", "motor_effort_true", "motor_effort_read"), "N m")
    units_ = {name: unit[kind] for name, kind in joint.items()} | motor
    return tuple(Signal(name, u, JOINTS) for name, u in units_.items())


def parts_of(chain: Chain, unit: dict[str, str], efforts: np.ndarray, frame: float) -> tuple[Part, ...]:
    """Arm, cables, motors, sensors and controller."""
    count, most = len(chain.names), RATIO * float(efforts.max())
    links = arm.forward_part(count, 0, scales(efforts, unit), unit)
    stand = Task("stand", ("link_start",), slots=(0,))
    motors = replace(
        gear_motor.PART,
        tasks=(Task("update", ("motor_effort_ref",)),),
        outputs=(Output.of_states(effort="motor_effort", effort_true="motor_effort_true"),),
    )
    seen = {"link_position": unit["position"], "motor_position": "rad", "motor_effort": "N m"}
    sizes = (SWING, SWING / RATIO, most)
    return (
        replace(links, tasks=(links.tasks[0], stand)),
        cable.part(1, SHARE * most, SPEED / RATIO, unit),
        motors,
        *(reading(name, signal, seen, slot, frame, size, count)
          for name, signal, slot, size in zip(SENSORS.values(), SEEN, (5, 2, 4), sizes, strict=True)),
        arm_drive.part(3, unit),
    )  # fmt: skip


def defaults_of(chain: Chain, efforts: np.ndarray, frame: float) -> dict[str, float]:
    """Values of what the robot file need not state: the arm's, and cables and motors of its size."""
    found = stated(chain, "arm") | losses(chain) | drive_defaults(chain, efforts, frame)
    for channel, m, effort in zip(chain.names, inertias(chain), efforts, strict=True):
        found[f"motor.current_max.{channel}"] *= RATIO
        found |= {
            f"cable.ratio.{channel}": RATIO, f"cable.by_previous.{channel}": 0.0, f"cable.by_next.{channel}": 0.0,
            f"cable.stiffness.{channel}": m * RESONANCE**2, f"cable.pretension.{channel}": TAUT * effort,
            f"cable.loss.{channel}": LOSS, f"cable.inertia.{channel}": REFLECTED * m * RATIO**2,
            f"cable.damping.{channel}": 0.0, f"cable.dry_friction.{channel}": 0.0,
            f"drive.viscosity.{channel}": 2.0 * (1.0 + REFLECTED) * m * BANDWIDTH,
        }  # fmt: skip
    return {name: float(value) for name, value in found.items()}
