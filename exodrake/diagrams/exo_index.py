"""The Exo-Index robot's table: wires, parts in order, and what its log shows. Slots as in `model.md`, Timing."""

from __future__ import annotations

from functools import cache

from exodrake.block import JOINTS, ONE, WIRES, Lanes, Wire
from exodrake.diagrams.machine import Column, Machine
from exodrake.effects import SHELF
from exodrake.systems import bus, controller, encoder, mocap, motor, sensor, tendon_finger

LANES = Lanes(("AF", "MF", "AE"), ("MCP", "PIP", "DIP"))

TABLE = (
    Wire("tension_ref", "N", WIRES),
    Wire("noise_tension", "-", WIRES),
    Wire("noise_angle", "-", JOINTS),
    Wire("lottery", "-", WIRES),
    Wire("speed_cmd", "m/s", WIRES),
    Wire("speed_applied", "m/s", WIRES),
    Wire("stroke", "m", WIRES),
    Wire("wire_speed", "m/s", WIRES),
    Wire("spool_angle", "rad", WIRES),
    Wire("tension", "N", WIRES),
    Wire("tension_finger", "N", WIRES),
    Wire("angle", "rad", JOINTS),
    Wire("rate", "rad/s", JOINTS),
    Wire("cell", "N", WIRES),
    Wire("tension_read", "N", WIRES),
    Wire("stroke_read", "m", WIRES),
    Wire("angle_read", "rad", JOINTS),
    Wire("mocap_lateness", "s", ONE),
)

COLUMNS = (
    Column("tension_ref", "tension_ref"),
    Column("tension", "tension_read"),
    Column("stroke", "stroke_read"),
    Column("speed_cmd", "speed_cmd", required=False),
    Column("angle", "angle_read", required=False),
)


@cache
def exo_index() -> Machine:
    """The nominal machine with every effect of the shelf at its neutral value."""
    return Machine(
        name="exo_index",
        lanes=LANES,
        wires=TABLE,
        blocks=(
            tendon_finger.BLOCK,
            motor.BLOCK,
            sensor.BLOCK,
            encoder.BLOCK,
            mocap.BLOCK,
            controller.BLOCK,
            bus.BLOCK,
        ),
        given=("tension_ref", "noise_tension", "noise_angle", "lottery"),
        columns=COLUMNS,
        shelf=SHELF,
    )
