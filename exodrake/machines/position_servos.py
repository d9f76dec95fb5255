"""Machines of ideal position servos (command -> joint -> reading); they differ in effects and parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from exodrake.core.effect import Effect
from exodrake.core.machine import Column, Machine
from exodrake.core.segment import Segment
from exodrake.core.signal import JOINTS, NORMAL, SCALAR, Axes, Signal
from exodrake.effects import LIBRARY
from exodrake.systems import angle_reading, joint, joint_command

FRAMES = replace(LIBRARY["timing.command_latency"].parameters[0], axis=JOINTS)  # each joint late by its own
REFERENCES = (Signal("angle_ref", "rad", JOINTS), Signal("angle_start", "rad", JOINTS))
BEND = Signal("bend", "rad", JOINTS)
REST = (
    Signal("noise_angle", "-", JOINTS, NORMAL),
    Signal("command", "rad", JOINTS),
    Signal("origin", "rad", JOINTS),
    Signal("setting", "rad", JOINTS),
    Signal("ready", "-", SCALAR),
    Signal("angle", "rad", JOINTS),
    Signal("angle_read", "rad", JOINTS),
)


def noise_std(parameter: Callable[[str], float]) -> dict[str, float]:
    """Noise standard deviation of an angle [rad]."""
    return {"angle": parameter("reading.floor")}


def joint_machine(
    name: str,
    part: str,
    joints: tuple[str, ...],
    library: tuple[Effect, ...],
    frame: float,
    max_effects: int,
    bent: bool = False,
) -> Machine:
    """A machine of position servos.

    Args:
        name: of the machine.
        part: name of the part that moves the joints.
        joints: names of the joints.
        library: its effects.
        frame: frame period [s].
        max_effects: effects that a diagnosis may name together.
        bent: whether logs state the bend of each joint's sheath.
    """
    references = (*REFERENCES, BEND) if bent else REFERENCES
    return Machine(
        name=name,
        axes=Axes((), joints),
        signals=(*references, *REST),
        parts=(
            replace(joint.PART, name=part),
            joint_command.SET_PART if bent else joint_command.PART,
            angle_reading.PART,
        ),
        inputs=(*(s.name for s in references), "noise_angle"),
        columns=(*(Column(s.name, s.name) for s in references), Column("angle", "angle_read", label="Joint angle")),
        effects=library,
        frame=frame,
        slots=4,
        noise=tuple(f"reading.sigma.{j}" for j in joints),
        resolution=tuple(f"reading.step.{j}" for j in joints),
        compared=("angle",),
        noise_std=noise_std,
        segments=(Segment(part, "angle"),),
        max_effects=max_effects,
        reference_limits=("angle_min", "angle_max"),
    )
