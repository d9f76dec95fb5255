"""EMPS, an electro-mechanical positioning system: drive -> carriage -> scale, a position loop at 1 kHz."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from exodrake.core.machine import Column, Machine
from exodrake.core.signal import JOINTS, Lanes, Wire
from exodrake.effects import (
    carriage_coulomb_friction,
    carriage_direction,
    carriage_offset,
    carriage_presliding_friction,
    carriage_stribeck_friction,
    carriage_viscous_friction,
)
from exodrake.systems import carriage, linear_scale, position_drive

SHELF = (
    carriage_viscous_friction.EFFECT,
    carriage_direction.EFFECT,
    carriage_offset.EFFECT,
    carriage_coulomb_friction.EFFECT,
    carriage_stribeck_friction.EFFECT,
    carriage_presliding_friction.EFFECT,
)
TABLE = (
    Wire("position_ref", "m", JOINTS),
    Wire("position_start", "m", JOINTS),
    Wire("speed_start", "m/s", JOINTS),
    Wire("noise_position", "-", JOINTS),
    Wire("force", "N", JOINTS),
    Wire("position", "m", JOINTS),
    Wire("position_read", "m", JOINTS),
)
COLUMNS = (
    Column("position_ref", "position_ref"),
    Column("position_start", "position_start"),
    Column("speed_start", "speed_start"),
    Column("position", "position_read"),
    Column("force", "force"),
)


def floors(number: Callable[[str], float]) -> dict[str, float]:
    """Repeatability of place [m] and force [N]."""
    return {"position": number("scale.floor"), "force": number("drive.floor")}


@cache
def emps() -> Machine:
    """The frictionless inertia under its drive, with every effect of its shelf at its neutral value."""
    return Machine(
        name="emps",
        lanes=Lanes((), ("carriage",)),
        wires=TABLE,
        blocks=(carriage.BLOCK, linear_scale.BLOCK, position_drive.BLOCK),
        given=("position_ref", "position_start", "speed_start", "noise_position"),
        columns=COLUMNS,
        shelf=SHELF,
        frame=1e-3,
        slots=16,  # so short that from reading to force takes the drive next to no time
        noise=("scale.sigma",),
        resolution=("scale.step",),
        compared=("position", "force"),
        floors=floors,
        segments={"drive": "force", "carriage": "position"},
        depth=4,
    )
