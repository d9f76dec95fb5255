"""The Exo-Index robot's table: wires, parts in order, and what its log shows. Slots as in `model.md`, Timing."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from exodrake.core.machine import Column, Machine, Observer
from exodrake.core.signal import JOINTS, NORMAL, SCALAR, TENDONS, UNIFORM, Axes, Delay, Signal
from exodrake.effects import effects_of
from exodrake.systems import bus, controller, encoder, mocap, motor, sensor, tendon_finger

AXES = Axes(("AF", "MF", "AE"), ("MCP", "PIP", "DIP"))

TABLE = (
    Signal("tension_ref", "N", TENDONS),
    Signal("noise_tension", "-", TENDONS, NORMAL),
    Signal("noise_angle", "-", JOINTS, NORMAL),
    Signal("packet_arrival", "-", TENDONS, UNIFORM),
    Signal("speed_cmd", "m/s", TENDONS),
    Signal("speed_applied", "m/s", TENDONS),
    Signal("stroke", "m", TENDONS),
    Signal("wire_speed", "m/s", TENDONS),
    Signal("spool_angle", "rad", TENDONS),
    Signal("tension", "N", TENDONS),
    Signal("tension_finger", "N", TENDONS),
    Signal("angle", "rad", JOINTS),
    Signal("rate", "rad/s", JOINTS),
    Signal("cell", "N", TENDONS),
    Signal("tension_read", "N", TENDONS),
    Signal("stroke_read", "m", TENDONS),
    Signal("angle_read", "rad", JOINTS),
    Signal("mocap_delay", "s", SCALAR),
)

PARTS = (tendon_finger.PART, motor.PART, sensor.PART, encoder.PART, mocap.PART, controller.PART, bus.PART)

LATE = Delay("mocap_delay", "noise_angle", "mocap.sigma_q")
COLUMNS = (
    Column("tension_ref", "tension_ref"),
    Column("tension", "tension_read"),
    Column("stroke", "stroke_read"),
    Column("speed_cmd", "speed_cmd", required=False, label="Speed command"),
    Column("angle", "angle_read", required=False, label="Joint angle", delay=LATE),
)
COLOURS = {  # tendons: Okabe and Ito; joints: Tol's muted scheme
    "AF": "#0072b2", "MF": "#009e73", "AE": "#d55e00", "MCP": "#332288", "PIP": "#aa4499", "DIP": "#999933",
}  # fmt: skip


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
    """The nominal machine with every effect of the effect library at its neutral value."""
    return Machine(
        name="exo_index",
        axes=AXES,
        signals=TABLE,
        parts=PARTS,
        inputs=("tension_ref", "noise_tension", "noise_angle", "packet_arrival"),
        columns=COLUMNS,
        effects=effects_of(PARTS),
        noise=("sensor.sigma_F", "mocap.sigma_q"),
        resolution=("sensor.q_F", "encoder.q_theta"),
        compared=("tension", "stroke", "speed_cmd", "angle"),
        noise_std=floors,
        segments={"motor": "stroke", "tendon": "tension", "finger": "angle"},
        observer=Observer("speed_cmd", "stroke", ("motor", "theta"), "motor.r", gain=0.2),
        colours=COLOURS,
        operating_point={"AF": 4.0, "MF": 3.0, "AE": 1.0},
    )
