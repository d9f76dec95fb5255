"""A robot of the reference simulator: layout of its arrays, nominal parameters of model.md, injected faults, motion.

SI throughout. The state vector holds three values (AF, MF, AE or MCP, PIP, DIP) per quantity; a quantity no effect uses
stays at rest.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

WIRES = ("AF", "MF", "AE")
JOINTS = ("MCP", "PIP", "DIP")
# quantity -> absolute tolerance of the integrator, well below what the comparison with the reference resolves
TOLERANCES = {
    "rotor": 1.0,  # rad/s
    "theta": 1e-4,  # rad, of the gear's output
    "integrator": 1e-4,  # A
    "cell": 1e-3,  # N
    "cell_second": 1e-3,  # N
    "command_lag": 1.0,  # rad/s
    "capstan": 2e-3,  # N
    "bristle": 1e-7,  # m
    "creep_fast": 1e-6,  # m
    "creep_slow": 1e-6,  # m
    "garment": 1e-6,  # m
    "pulley": 2e-3,  # N
    "mount": 1e-6,  # m
    "mount_rate": 1e-4,  # m/s
    "felt_tension": 1e-2,  # N
    "angle": 1e-4,  # rad
    "rate": 1e-2,  # rad/s
    "relax_fast": 1e-3,  # rad
    "relax_slow": 1e-3,  # rad
    "joint_loss": 5e-3,
}
STATES = tuple(TOLERANCES)
STATE_SIZE = 3 * len(STATES)
ROTOR, THETA, INTEGRATOR, CELL, CELL_SECOND, COMMAND_LAG, CAPSTAN, BRISTLE = range(0, 24, 3)
CREEP_FAST, CREEP_SLOW, GARMENT, PULLEY, MOUNT, MOUNT_RATE, FELT_TENSION = range(24, 45, 3)
ANGLE, RATE, RELAX_FAST, RELAX_SLOW, JOINT_LOSS = range(45, 60, 3)

# Inputs that change over time, one column each, linear between frames.
(REST_SHIFT, VOLUNTARY, STIFFENED, TREMOR_PHASE, WIRE_SHIFT, SUPPLY, ROUTER_SHIFT, CELL_DRIFT, MARKER_SHIFT, NEXT) = (
    0, 3, 6, 9, 10, 13, 14, 15, 18, 21)  # fmt: skip
INPUT_SIZE = NEXT

# Fields of the parameter record: values of the whole robot, of each wire or joint, of each side and joint.
_SCALARS = """
    tau_cell kp kd speed_max spool_config gear growth_pitch capstan_travel stribeck_speed viscous_speed
    bristle_stiffness bristle_damping contact_depth contact_stiffness tremor_torque tremor_frequency gravity_x
    gravity_y abduction notch_angle notch_width notch_torque snag_force snag_place snag_width rub latency
    supply_voltage winding_resistance slip_rate slip_load has_inputs hysteresis_power quantum_force sticky
"""
_TRIPLES = """
    torque_constant inertia damping spool loop_p loop_i current_max wire_stiffness stiffness_joint rest
    damping_joint stop_flexed stop_extended stop_rate stop_torque length mass centre unit_inertia command_lag
    dead_zone soft_limit growth eccentricity eccentric_phase leak capstan coulomb static viscous garment
    garment_stiffening creep creep_time slack toe stiffening cell_gain cell_offset cell_bow cell_lag pulley
    pulley_travel crosstalk factor hardening relaxing relaxing_time loss loss_width loss_by_angle coupling
    coupling_ratio router_give mount_frequency mount_ratio spastic_gain spastic_threshold tremor_share homing
    marker_gain marker_offset
"""
_GEOMETRY = ["axial_distal", "axial_proximal", "height_distal", "height_proximal", "straight"]
ROBOT = np.dtype(
    [(name, float) for name in _SCALARS.split()]
    + [(name, float, (3,)) for name in _TRIPLES.split()]
    + [(name, float, (2, 3)) for name in _GEOMETRY]
)


def tolerance_vector():
    """Absolute tolerances, in the order of the state vector."""
    return np.repeat([TOLERANCES[name] for name in STATES], 3)


# name: (value, relative standard deviation). SI. Values: model.md, "Numbers". Tolerance 3 % [A]; a
# machined spool less [A]; what is set or counted, none.
TOLERANCE = 0.03
MACHINED = 0.01
EXACT = 0.0
NOMINAL = {
    "torque_constant": (0.0115, TOLERANCE),  # N m/A
    "inertia": (5.6e-8, TOLERANCE),  # kg m2
    "damping": (7.8e-8, TOLERANCE),  # N m s/rad
    "spool": (7.5e-3, MACHINED),  # m
    "loop_p": (5.0e-4, TOLERANCE),  # A s/rad
    "loop_i": (0.0125, TOLERANCE),  # A/rad
    "current_max": (0.3, TOLERANCE),  # A
    "wire_stiffness": (2700.0, TOLERANCE),  # N/m
    "axial": (5e-3, TOLERANCE),  # m
    "height_flexor": (3e-3, TOLERANCE),  # m
    "height_extensor": (5e-3, TOLERANCE),  # m
    "stiffness_joint": ((0.080, 0.060, 0.035), TOLERANCE),  # N m/rad
    "rest": ((0.20, 0.30, 0.15), TOLERANCE),  # rad
    "damping_joint": ((0.004, 0.002, 0.001), TOLERANCE),  # N m s/rad
    "stop_flexed": ((1.30, 1.50, 0.95), TOLERANCE),  # rad
    "stop_extended": ((-0.30, 0.0, 0.0), TOLERANCE),  # rad
    "stop_rate": (12.0, TOLERANCE),  # 1/rad
    "stop_torque": (0.002, TOLERANCE),  # N m
    "length": ((42.64e-3, 20.14e-3, 18.72e-3), TOLERANCE),  # m
    "mass": ((11.9e-3, 4.5e-3, 3.2e-3), TOLERANCE),  # kg
    "radius": ((9e-3, 8e-3, 7e-3), TOLERANCE),  # m
    "tau_cell": (1.6e-3, TOLERANCE),  # s
    "gear": (69.0, EXACT),
    "kp": (6e-3, EXACT),  # m/(s N)
    "kd": (1e-4, EXACT),  # m/N
    "speed_max": (0.1, EXACT),  # m/s
    "quantum_force": (0.004, EXACT),  # N
}
WHOLE = ("tau_cell", "gear", "kp", "kd", "speed_max", "quantum_force")
NOISE_FORCE = 0.01  # N
NOISE_ANGLE = 0.005  # rad
QUANTUM_THETA = 2.0 * np.pi / (16 * 69)  # rad
SPOOL_CONFIGURED = 7.5e-3  # m, what drive and log assume
TENSION_MAX = np.array([12.0, 8.0, 8.0])  # N
TENSION_MIN = 0.3  # N
# Constants of the reference simulator's own functional forms [A]; without an effect they act on nothing.
FORMS = {
    "hysteresis_power": 1.5,
    "growth_pitch": 6e-3,  # m of wire, one layer's staircase
    "viscous_speed": 0.1,  # m/s, where shear thinning sets in
    "stribeck_speed": 3e-3,  # m/s
    "capstan_travel": 1e-4,  # m, presliding
    "pulley_travel": 2e-4,  # m
    "bristle_stiffness": 1.5e4,  # N/m
    "bristle_damping": 5.0,  # N s/m
}
CLIP = 2.5  # standard deviations


def draw_parameters(rng: np.random.Generator | None = None) -> dict[str, np.ndarray]:
    """Draw one robot's parameters.

    Args:
        rng: Random generator; the nominal parameters without it.

    Returns:
        Name -> value [SI], each times its own clipped normal factor: scalar, (3,) by wire or joint, or (2, 3) by side
        and joint.
    """
    shapes = {"axial": (2, 3)}
    parameters = {}
    for name, (value, tolerance) in NOMINAL.items():
        shape = () if name in WHOLE else shapes.get(name, (3,))
        factor = 1.0 if rng is None else 1.0 + tolerance * np.clip(rng.standard_normal(shape), -CLIP, CLIP)
        parameters[name] = np.broadcast_to(np.asarray(value, float), shape) * factor
    return parameters


def robot_record(parameters, quantised=True):
    """Parameter record of a robot without any effect; phalanges are solid cylinders, centre of mass half way."""
    record = np.zeros(1, ROBOT)[0]
    axial = parameters["axial"]
    heights = np.array([parameters["height_flexor"], parameters["height_extensor"]])
    for name in ("axial_distal", "axial_proximal"):
        record[name] = axial
    for name in ("height_distal", "height_proximal"):
        record[name] = heights
    length = parameters["length"]
    record["centre"] = length / 2
    record["unit_inertia"] = length**2 / 3 + parameters["radius"] ** 2 / 4
    for name in parameters:
        if name in ROBOT.names:
            record[name] = parameters[name]
    record["spool_config"] = SPOOL_CONFIGURED
    record["factor"] = 1.0
    if not quantised:
        record["quantum_force"] = 0.0
    for name, value in FORMS.items():
        record[name] = value
    return settle_routing(record)


def settle_routing(record):
    """Distance between the routers at q = 0, so that l(0) = 0 whatever the heights."""
    heights = record["height_distal"] - record["height_proximal"]
    record["straight"] = np.hypot(record["axial_distal"] + record["axial_proximal"], heights)
    return record


FRAME = 0.02


@dataclass(frozen=True)
class InjectedFault:
    """One effect in a robot.

    Attributes:
        id: Id of the effect.
        wires: Wires it sits on; empty for all or none.
        joints: Joints it sits on; empty for all or none.
        parameters: Parameters by effects.md's names [SI].
    """

    id: str
    wires: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    parameters: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Protocol:
    """A motion: name and tension references (n, 3) [N], one row per 20 ms frame."""

    name: str
    reference: np.ndarray


@dataclass(frozen=True)
class RobotSpec:
    """A robot: its parameters (see `draw_parameters`), injected faults, and whether sensors are noisy and quantised."""

    parameters: dict[str, Any] = field(default_factory=draw_parameters)
    effects: tuple[InjectedFault, ...] = ()
    noisy: bool = True
