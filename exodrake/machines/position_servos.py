"""Machines of joints that go where they are told: commands -> joints -> reading. They differ in shelf and numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from exodrake.core.effect import Effect
from exodrake.core.machine import Column, Machine
from exodrake.core.signal import JOINTS, ONE, Lanes, Wire
from exodrake.systems import angle_reading, joint, joint_command

ASKED = (Wire("angle_ref", "rad", JOINTS), Wire("angle_start", "rad", JOINTS))
BEND = Wire("bend", "rad", JOINTS)
REST = (
    Wire("noise_angle", "-", JOINTS),
    Wire("command", "rad", JOINTS),
    Wire("origin", "rad", JOINTS),
    Wire("setting", "rad", JOINTS),
    Wire("ready", "-", ONE),
    Wire("angle", "rad", JOINTS),
    Wire("angle_read", "rad", JOINTS),
)


def floors(number: Callable[[str], float]) -> dict[str, float]:
    """Noise of an angle [rad]."""
    return {"angle": number("reading.floor")}


def joint_machine(
    name: str,
    part: str,
    joints: tuple[str, ...],
    shelf: tuple[Effect, ...],
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
        lanes=Lanes((), joints),
        wires=(*asked, *REST),
        blocks=(
            replace(joint.BLOCK, name=part),
            joint_command.SET_BLOCK if bent else joint_command.BLOCK,
            angle_reading.BLOCK,
        ),
        given=(*(w.name for w in asked), "noise_angle"),
        columns=(*(Column(w.name, w.name) for w in asked), Column("angle", "angle_read")),
        shelf=shelf,
        frame=frame,
        slots=4,
        noise=tuple(f"reading.sigma.{j}" for j in joints),
        resolution=tuple(f"reading.step.{j}" for j in joints),
        compared=("angle",),
        floors=floors,
        segments={part: "angle"},
        depth=depth,
    )
