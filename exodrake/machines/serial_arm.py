"""Machines of one serial arm, described by the `arm` section of a robot file and a URDF file beside it; no code.

    machine: my_arm
    arm: {urdf: arm.urdf, form: inverse, frame: 0.005}      # or closed-loop, or cable; tip: LINK where joints branch

`inverse`: motion is measured and the effort predicted from it. `closed-loop`: references go through PD controller,
motors and forward dynamics. `cable`: the same with cables between motors and joints. Parameters that the URDF states
need not be in the robot file. A linear or rotary axis is an arm of one joint.

With cables the signals go

    position_ref -> PD controller -> A' -> motors -> cables -> arm      motor_position -> A -> controller

and a log holds references, positions and efforts of the motors and, where encoders or a camera see them, positions of
the joints (`position`). The matrix A, cables and motors are `cable` in the robot file.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.machine import Column, Machine, Segment
from exodrake.core.mechanism import Chain
from exodrake.core.part import JOINTS, Axes, Output, Part, Signal, Task
from exodrake.core.schema import mapping, number, text
from exodrake.effects import friction
from exodrake.machines import arm_defaults as arm
from exodrake.machines.arm_defaults import SWING, arm_values, drawn, reading, signals, units
from exodrake.machines.urdf import read_urdf
from exodrake.physics import arm as dynamics, arm_drive, cable, gear_motor

FORMS = ("inverse", "closed-loop", "cable")
SLOWEST, TICK = 10.0, 5e-4  # s: longest frame; the plant's tick at most, so that a wrist's resonance is resolved
SECTION = mapping(
    {"urdf": text(), "form": text(FORMS), "frame": number(above=0.0, high=SLOWEST), "tip": text()}, required=("urdf",)
)
FRAME = 0.005  # s, as most recordings of arms: assumed
REST = 0.01  # of the largest speed, below which dry friction of the largest effort counts as rest: assumed
CROSSTALK = ("torque.crosstalk", "encoder.crosstalk")  # not tried: joints are measured one by one
OFFSET = ("arm.offset",)  # which is `torque.offset` in inverse dynamics

# of arms with cables
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
OF_CABLES = ("arm.joint_compliance", "arm.rotor_inertia")  # which the cables and motors are themselves


def arm_machine(name: str, section: Any, folder: Path, source: str) -> Machine:
    """The machine of an `arm` section of a robot file in a folder, in which the URDF file must lie.

    InputError for an unknown key, and a URDF file that is absent, elsewhere or no serial arm.
    """
    section = SECTION(section, f"{source}, 'arm'")
    path = (folder / section["urdf"]).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise InputError(f"{source}: urdf {section['urdf']} lies outside the folder of the robot file")
    chain = read_urdf(path, section.get("tip", ""))
    make = dict(zip(FORMS, (inverse_machine, closed_machine, cable_machine), strict=True))
    return make[section.get("form", FORMS[0])](name, chain, section.get("frame", FRAME))


def make_machine(
    name: str, chain: Chain, parts: tuple[Part, ...], sensors: tuple[str, ...], without: tuple[str, ...], **rest: Any
) -> Machine:
    """The machine of an arm of some parts, of which `sensors` measure; `without`: ids of effects that it has not."""
    return Machine(
        name=name,
        axes=Axes((), chain.names),
        parts=parts,
        effects=arm.effects_in(units(chain), parts, without),
        noise=tuple(f"{sensor}.sigma.{j}" for sensor in sensors for j in chain.names),
        resolution=tuple(f"{sensor}.step.{j}" for sensor in sensors for j in chain.names),
        max_effects=6,
        reference_limits=("position_min", "position_max"),
        skeleton=arm.shape,
        mechanism=arm.mechanism,
        **rest,
    )


def count_slots(frame: float, least: int = 4) -> int:
    """Number of slots of a frame [s]."""
    return max(least, round(np.ceil(frame / TICK)))


def inverse_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in inverse-dynamics form: position, velocity and acceleration are measured, the effort is predicted."""
    unit, efforts = units(chain), arm.typical_efforts(chain)
    speed, force = unit["velocity"], unit["effort"]
    torque = reading("torque", "effort", unit, 0, frame, float(efforts.max()), len(chain.names))
    motion = signals(unit, "position", "velocity", "acceleration")
    shown = {**{s.name: s.name for s in motion}, "effort": "effort_read"}
    found = arm.columns(chain, shown, {"velocity": "position", "acceleration": "velocity"})
    return make_machine(
        name,
        chain,
        (dynamics.inverse_part(arm.scales(efforts, unit), unit), torque),
        ("torque",),
        CROSSTALK + OFFSET,
        signals=(*motion, *drawn("effort"), *signals(unit, "effort", "effort_read")),
        inputs=(*(s.name for s in motion), "noise_effort", "arrival_effort"),
        columns=found,
        frame=frame,
        slots=1,
        compared=(found[-1].kind,),
        noise_std=lambda parameter: {found[-1].kind: parameter("torque.repeatability")},
        segments=(Segment("arm", found[-1].kind),),
        separate=True,
        defaults=arm_values(chain),
        recorded={"arm.mobility": lambda size: REST * size.get(speed, np.inf) / max(size.get(force, 0.0), 1e-12)},
    )


def closed_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in closed loop: controller, motors, forward dynamics, encoders and torque sensors."""
    unit, efforts, count = units(chain), arm.typical_efforts(chain), len(chain.names)
    encoder = reading("encoder", "position", unit, 1, frame, SWING, count)
    torque = reading("torque", "effort", unit, 3, frame, float(efforts.max()), count)
    forward = dynamics.forward_part(count, 0, arm.scales(efforts, unit), unit)
    given = signals(unit, "position_ref", "position_start")
    inner = signals(unit, "position", "position_read", "effort_ref", "effort", "effort_true", "effort_read")
    noises = drawn("position", "effort")
    shown = {s.name: s.name for s in given}
    shown |= {"effort_ref": "effort_ref", "position": "position_read", "effort": "effort_read"}
    found = arm.columns(chain, shown, {})
    position, effort = found[-2].kind, found[-1].kind
    sensors = {position: "encoder", effort: "torque"}
    return make_machine(
        name,
        chain,
        (forward, gear_motor.PART, encoder, torque, arm_drive.part(2, unit)),
        tuple(sensors.values()),
        CROSSTALK,
        signals=(*given, *noises, *inner, Signal("link_position", unit["position"], JOINTS)),
        inputs=(*(s.name for s in given), *(s.name for s in noises)),
        columns=found,
        frame=frame,
        slots=count_slots(frame),
        compared=(position, effort),
        noise_std=lambda parameter: {k: parameter(f"{s}.repeatability") for k, s in sensors.items()},
        segments=(Segment("drive", effort, (position,)), Segment("arm", position, (effort,))),
        loop=arm.joint_control(chain, {"arm.coulomb_friction": {}}),
        defaults=arm_values(chain) | arm.drive_defaults(chain, efforts, frame),
    )


def cable_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in closed loop that motors move through cables: arm, cables, motors, sensors and controller."""
    unit, efforts, count = units(chain), arm.typical_efforts(chain), len(chain.names)
    most = RATIO * float(efforts.max())
    forward = dynamics.forward_part(count, 0, arm.scales(efforts, unit), unit)
    motors = replace(
        gear_motor.PART,
        tasks=(Task("update", ("motor_effort_ref",)),),
        outputs=(Output.of_states(effort="motor_effort", effort_true="motor_effort_true"),),
    )
    seen = {"link_position": unit["position"], "motor_position": "rad", "motor_effort": "N m"}
    readings = zip(SENSORS.values(), SEEN, (5, 2, 4), (SWING, SWING / RATIO, most), strict=True)
    parts = (
        replace(forward, tasks=(forward.tasks[0], Task("stand", ("link_start",), slots=(0,)))),
        cable.part(1, arm.SHARE * most, arm.SPEED / RATIO, unit),
        motors,
        *(reading(sensor, signal, seen, slot, frame, size, count) for sensor, signal, slot, size in readings),
        arm_drive.part(3, unit),
    )
    effects = arm.effects_in(unit, parts, ())
    rubbing = tuple(
        e.id for e in effects
        if e.id.startswith("arm.") and all(law.__module__ == friction.__name__ for law in e.at.values())
    )  # fmt: skip
    kinds = {"position": "position", "position_read": "position", "link_position": "position", "effort_ref": "effort"}
    kinds |= {"link_position_read": "position", "effort_true": "effort", "link_start": "position"}
    inner = {signal: unit[kind] for signal, kind in kinds.items()}  # of joints, then of motors
    inner |= dict.fromkeys(("motor_start", "motor_position", "motor_position_read"), "rad")
    inner |= dict.fromkeys(("motor_effort_ref", "motor_effort", "motor_effort_true", "motor_effort_read"), "N m")
    given = (Signal("position_ref", unit["position"], JOINTS), Signal("position_start", unit["position"], JOINTS))
    noises = drawn(*SEEN)
    return make_machine(
        name,
        chain,
        parts,
        tuple(SENSORS.values()),
        (*(f"{sensor}.crosstalk" for sensor in SENSORS.values()), *rubbing, *OF_CABLES),
        signals=(*given, *noises, *(Signal(signal, u, JOINTS) for signal, u in inner.items())),
        inputs=(*(s.name for s in given), *(s.name for s in noises)),
        columns=(*(Column(s.name, s.name) for s in given), *COLUMNS),
        frame=frame,
        slots=count_slots(frame, 6),
        compared=tuple(SENSORS),
        noise_std=lambda parameter: {kind: parameter(f"{sensor}.repeatability") for kind, sensor in SENSORS.items()},
        segments=SEGMENTS,
        loop=arm.joint_control(chain, {}),
        defaults=cable_defaults(chain, efforts, frame),
    )


def cable_defaults(chain: Chain, efforts: np.ndarray, frame: float) -> dict[str, float]:
    """Values of what the robot file need not state: the arm's, and cables and motors of its size."""
    found = arm_values(chain) | arm.drive_defaults(chain, efforts, frame)
    for channel, m, effort in zip(chain.names, arm.compute_inertias(chain), efforts, strict=True):
        found[f"motor.current_max.{channel}"] *= RATIO
        found |= {
            f"cable.ratio.{channel}": RATIO, f"cable.by_previous.{channel}": 0.0, f"cable.by_next.{channel}": 0.0,
            f"cable.stiffness.{channel}": m * RESONANCE**2, f"cable.pretension.{channel}": TAUT * effort,
            f"cable.loss.{channel}": LOSS, f"cable.inertia.{channel}": REFLECTED * m * RATIO**2,
            f"cable.damping.{channel}": 0.0, f"cable.dry_friction.{channel}": 0.0,
            f"drive.viscosity.{channel}": 2.0 * (1.0 + REFLECTED) * m * arm.BANDWIDTH,
        }  # fmt: skip
    return {name: float(value) for name, value in found.items()}
