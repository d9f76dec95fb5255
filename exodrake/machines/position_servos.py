"""Machines of joints that go where they are told: commands -> joints -> reading. They differ in effect library and
numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from exodrake.core.effect import Effect
from exodrake.core.machine import Column, Machine
from exodrake.core.signal import JOINTS, NORMAL, SCALAR, Axes, Signal
from exodrake.systems import angle_reading, joint, joint_command

ASKED = (Signal("angle_ref", "rad", JOINTS), Signal("angle_start", "rad", JOINTS))
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


def floors(number: Callable[[str], float]) -> dict[str, float]:
    """Noise of an angle [rad]."""
    return {"angle": number("reading.floor")}


def joint_machine(
    name: str,
    part: str,
    joints: tuple[str, ...],
    library: tuple[Effect, ...],
    frame: float,
    depth: int,
    bent: bool = False,
) -> Machine:
    """A machine of joints.

    Args: part: what reports call the part that moves the joints; frame [s]; depth: effects that may be named together;
        bent: whether logs say how far each joint's sheath is bent.
    """
    asked = (*ASKED, BEND) if bent else ASKED
    return Machine(
        name=name,
        axes=Axes((), joints),
        signals=(*asked, *REST),
        parts=(
            replace(joint.PART, name=part),
            joint_command.SET_PART if bent else joint_command.PART,
            angle_reading.PART,
        ),
        inputs=(*(w.name for w in asked), "noise_angle"),
        columns=(*(Column(w.name, w.name) for w in asked), Column("angle", "angle_read", label="Joint angle")),
        effects=library,
        frame=frame,
        slots=4,
        noise=tuple(f"reading.sigma.{j}" for j in joints),
        resolution=tuple(f"reading.step.{j}" for j in joints),
        compared=("angle",),
        noise_std=floors,
        segments={part: "angle"},
        max_effects=depth,
    )
