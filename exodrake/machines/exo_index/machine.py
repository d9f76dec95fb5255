"""The Exo-Index robot's table: wires, parts in order, and what its log shows. Slots as in `model.md`, Timing."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from exodrake.core.machine import Column, Machine, Steered
from exodrake.core.signal import JOINTS, ONE, WIRES, Lanes, Wire
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


def floors(number: Callable[[str], float]) -> dict[str, float]:
    """Noise of each kind of signal from the sensors' numbers: N, m, m/s, rad. Rounding to q adds q^2/12."""
    tension = np.sqrt(number("sensor.sigma_F") ** 2 + TWELFTH * number("sensor.q_F") ** 2)
    damped = np.hypot(
        number("controller.kp") + number("controller.kd") / number("controller.period"),
        number("controller.kd") / number("controller.period"),
    )
    step = number("encoder.q_theta") * number("encoder.radius")
    return {
        "tension": float(tension),
        "stroke": float(np.sqrt(TWELFTH) * step),
        "speed_cmd": float(tension * damped),
        "angle": number("mocap.sigma_q"),
    }


TWELFTH = 1.0 / 12.0  # variance of a rounding error in units of its step squared


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
        noise=("sensor.sigma_F", "mocap.sigma_q"),
        resolution=("sensor.q_F", "encoder.q_theta"),
        compared=("tension", "stroke", "speed_cmd", "angle"),
        floors=floors,
        segments={"motor": "stroke", "tendon": "tension", "finger": "angle"},
        steered=Steered("speed_cmd", "stroke", ("motor", "theta"), "motor.r", gain=0.2),
    )
