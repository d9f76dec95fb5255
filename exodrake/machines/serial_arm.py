"""Machines of one serial arm, described by the `arm` section of a robot file and a URDF file beside it; no code.

    machine: my_arm
    arm: {urdf: arm.urdf, form: inverse, frame: 0.005}      # or closed-loop, or cable; tip: LINK where joints branch

`inverse`: motion is measured and the effort predicted from it. `closed-loop`: references go through PD controller,
motors and forward dynamics. `cable`: the same with cables between motors and joints (`cable_arm.py`). Parameters that
the URDF states need not be in the robot file. A linear or rotary axis is an arm of one joint.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.machine import Machine, Segment
from exodrake.core.mechanism import Chain
from exodrake.core.part import JOINTS, Axes, Signal
from exodrake.core.schema import mapping, number, text
from exodrake.machines.arm_defaults import (
    SWING,
    both_std,
    columns,
    drawn,
    drive_defaults,
    effects_in,
    joint_control,
    losses,
    mechanism,
    noise_std,
    reading,
    renamed,
    scales,
    shape,
    signals,
    stated,
    typical_efforts,
    units,
)
from exodrake.machines.cable_arm import cable_machine
from exodrake.machines.urdf import read_urdf
from exodrake.physics import arm, arm_drive, gear_motor

FORMS = ("inverse", "closed-loop", "cable")
SLOWEST, TICK = 10.0, 5e-4  # s: longest frame; the plant's tick at most, so that a wrist's resonance is resolved
SECTION = mapping(
    {"urdf": text(), "form": text(FORMS), "frame": number(above=0.0, high=SLOWEST), "tip": text()}, required=("urdf",)
)
FRAME = 0.005  # s, as most recordings of arms: assumed
REST = 0.01  # of the largest speed, below which dry friction of the largest effort counts as rest: assumed
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
    form, frame = section.get("form", FORMS[0]), section.get("frame", FRAME)
    if form == "cable":
        return cable_machine(name, chain, slots_of(frame), frame)
    return (inverse_machine if form == FORMS[0] else closed_machine)(name, chain, frame)


def slots_of(frame: float) -> int:
    """Slots of a frame [s], four at least."""
    return max(4, round(np.ceil(frame / TICK)))


def inverse_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in inverse-dynamics form: position, velocity and acceleration are measured, the effort is predicted."""
    unit, efforts, count = units(chain), typical_efforts(chain), len(chain.names)
    speed, force = unit["velocity"], unit["effort"]
    torque = reading("torque", "effort", unit, 0, frame, float(efforts.max()), count)
    parts = (arm.inverse_part(scales(efforts, unit), unit), torque)
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
        max_effects=6,
        reference_limits=("position_min", "position_max"),
        skeleton=shape,
        mechanism=mechanism,
        separate=True,
        defaults=stated(chain, "arm") | losses(chain),
        recorded={"arm.mobility": lambda size: REST * size.get(speed, np.inf) / max(size.get(force, 0.0), 1e-12)},
    )


def closed_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in closed loop: controller, motors, forward dynamics, encoders and torque sensors."""
    unit, efforts, count = units(chain), typical_efforts(chain), len(chain.names)
    encoder = reading("encoder", "position", unit, 1, frame, SWING, count)
    torque = reading("torque", "effort", unit, 3, frame, float(efforts.max()), count)
    forward = arm.forward_part(count, 0, scales(efforts, unit), unit)
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
        slots=slots_of(frame),
        noise=tuple(f"{part}.sigma.{j}" for part in ("encoder", "torque") for j in chain.names),
        resolution=tuple(f"{part}.step.{j}" for part in ("encoder", "torque") for j in chain.names),
        compared=(position, effort),
        noise_std=lambda parameter: renamed(both_std(parameter), found),
        segments=(Segment("drive", effort, (position,)), Segment("arm", position, (effort,))),
        max_effects=6,
        reference_limits=("position_min", "position_max"),
        skeleton=shape,
        mechanism=mechanism,
        loop=joint_control(chain, {"arm.coulomb_friction": {}}),
        defaults=stated(chain, "arm") | losses(chain) | drive_defaults(chain, efforts, frame),
    )
