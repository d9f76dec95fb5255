"""The Exo-Index robot: its signals, its parts in order, and what its log shows; slots as in `model.md`, Timing."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from exodrake.core.machine import Column, Machine, Observer
from exodrake.core.signal import JOINTS, NORMAL, SCALAR, TENDONS, UNIFORM, Axes, Delay, Signal
from exodrake.effects import effects_of
from exodrake.machines.exo_index.loop import LOOP
from exodrake.machines.exo_index.segments import COMMAND_LINK, REGIME, SEGMENTS
from exodrake.machines.exo_index.skeleton import skeleton
from exodrake.physics import (
    bus,
    controller,
    controller_as_printed,
    encoder,
    finger_at_rest,
    mocap,
    motor,
    routers_as_printed,
    sensor,
    tendon_finger,
)

AXES = Axes(("AF", "MF", "AE"), ("MCP", "PIP", "DIP"))

SIGNALS = (
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
    Signal("tension_spool", "N", TENDONS),
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
    Column("tension", "tension_read", required=False),
    Column("stroke", "stroke_read"),
    Column("speed_cmd", "speed_cmd", required=False, label="Speed command"),
    Column("angle", "angle_read", required=False, label="Joint angle", delay=LATE),
)


def noise_std(parameter: Callable[[str], float]) -> dict[str, float]:
    """Noise standard deviation of each kind [N, m, m/s, rad], from the sensors' parameters."""
    tension = np.sqrt(parameter("sensor.sigma_F") ** 2 + TWELFTH * parameter("sensor.q_F") ** 2)
    period, kd = parameter("controller.period"), parameter("controller.kd")
    share = period / (period + parameter("controller.tau_D"))  # of the filtered derivative that is new in a frame
    now, later = parameter("controller.kp") + kd * share / period, kd * share**2 / period
    damped = np.hypot(now, later / np.sqrt(1.0 - (1.0 - share) ** 2))  # the command's own sum of squares, ki aside
    step = parameter("encoder.q_theta") * parameter("encoder.radius")
    return {
        "tension": float(tension),
        "stroke": float(np.sqrt(TWELFTH) * step),
        "speed_cmd": float(tension * damped),
        "angle": parameter("mocap.sigma_q"),
    }


STILL = 2e-4  # m/s: slower tendons count as at rest; a few encoder counts a second
SLACK = 0.15  # N: half the anti-slack reference of 0.3 N
COLOURS = {
    **{"AF": "#0072b2", "MF": "#009e73", "AE": "#d55e00"},  # Okabe and Ito: distinct to all eyes
    **{"MCP": "#332288", "PIP": "#aa4499", "DIP": "#999933"},  # Tol's muted scheme
}
TWELFTH = 1.0 / 12.0  # variance of a rounding error in units of its step squared


@cache
def machine() -> Machine:
    """The nominal machine with every effect of the library at its null value."""
    return Machine(
        name="exo_index",
        axes=AXES,
        signals=SIGNALS,
        parts=PARTS,
        inputs=("tension_ref", "noise_tension", "noise_angle", "packet_arrival"),
        columns=COLUMNS,
        effects=effects_of(PARTS),
        noise=("sensor.sigma_F", "mocap.sigma_q"),
        resolution=("sensor.q_F", "encoder.q_theta"),
        compared=("tension", "stroke", "speed_cmd", "angle"),
        noise_std=noise_std,
        segments=SEGMENTS,
        regime=REGIME,
        command_link=COMMAND_LINK,
        observer=Observer("speed_cmd", "stroke", ("motor", "theta"), "motor.r", gain=0.2),
        variants_available={
            "controller_as_printed": ("controller.damping", controller_as_printed.damping),
            "finger_at_rest": ("tendon_finger.rests_before", finger_at_rest.rests_before),
            "routers_as_printed": ("routers.applied_arm", routers_as_printed.applied_arm),
        },
        reference_limits=("F_min", "F_max"),
        experiments={
            "steps": "steps",
            "multisine": "multisine",
            "chirp": "chirp",
            "holds": "holds",
            "random motion": "random-motion:seed=0",
        },
        end_stops=("finger.q_f", "finger.q_e"),
        colours=COLOURS,
        skeleton=skeleton,
        loop=LOOP,
    )
