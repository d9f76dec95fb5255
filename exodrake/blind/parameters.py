"""Nominal numbers of model.md as this reality needs them, their scatter, and their way into the parameter record."""

import numpy as np

from exodrake.blind.records import ROBOT

# name: (value, relative scatter of one standard deviation). SI. Values: model.md, "Numbers". Scatter 3 % [A]; a
# machined spool less [A]; what is set or counted, none.
SCATTER = 0.03
MACHINED = 0.01
EXACT = 0.0
NOMINAL = {
    "torque_constant": (0.0115, SCATTER),  # N m/A
    "inertia": (5.6e-8, SCATTER),  # kg m2
    "damping": (7.8e-8, SCATTER),  # N m s/rad
    "spool": (7.5e-3, MACHINED),  # m
    "loop_p": (5.0e-4, SCATTER),  # A s/rad
    "loop_i": (0.0125, SCATTER),  # A/rad
    "current_max": (0.3, SCATTER),  # A
    "wire_stiffness": (2700.0, SCATTER),  # N/m
    "axial": (5e-3, SCATTER),  # m
    "height_flexor": (3e-3, SCATTER),  # m
    "height_extensor": (5e-3, SCATTER),  # m
    "stiffness_joint": ((0.080, 0.060, 0.035), SCATTER),  # N m/rad
    "rest": ((0.20, 0.30, 0.15), SCATTER),  # rad
    "damping_joint": ((0.004, 0.002, 0.001), SCATTER),  # N m s/rad
    "stop_flexed": ((1.30, 1.50, 0.95), SCATTER),  # rad
    "stop_extended": ((-0.30, 0.0, 0.0), SCATTER),  # rad
    "stop_rate": (12.0, SCATTER),  # 1/rad
    "stop_torque": (0.002, SCATTER),  # N m
    "length": ((42.64e-3, 20.14e-3, 18.72e-3), SCATTER),  # m
    "mass": ((11.9e-3, 4.5e-3, 3.2e-3), SCATTER),  # kg
    "radius": ((9e-3, 8e-3, 7e-3), SCATTER),  # m
    "tau_cell": (1.6e-3, SCATTER),  # s
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
# Constants of this reality's own functional forms [A]; without an effect they act on nothing.
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


def draw_numbers(rng=None):
    """One robot's numbers: nominal without a generator, else each scattered by its own clipped normal factor. Routing
    per side (2) and joint (3).
    """
    shapes = {"axial": (2, 3)}
    numbers = {}
    for name, (value, scatter) in NOMINAL.items():
        shape = () if name in WHOLE else shapes.get(name, (3,))
        factor = 1.0 if rng is None else 1.0 + scatter * np.clip(rng.standard_normal(shape), -CLIP, CLIP)
        numbers[name] = np.broadcast_to(np.asarray(value, float), shape) * factor
    return numbers


def robot_record(numbers, quantised=True):
    """Parameter record of a robot without any effect. Phalanges are solid cylinders, centre of mass half way."""
    record = np.zeros(1, ROBOT)[0]
    axial = numbers["axial"]
    heights = np.array([numbers["height_flexor"], numbers["height_extensor"]])
    for name in ("axial_distal", "axial_proximal"):
        record[name] = axial
    for name in ("height_distal", "height_proximal"):
        record[name] = heights
    length = numbers["length"]
    record["centre"] = length / 2
    record["unit_inertia"] = length**2 / 3 + numbers["radius"] ** 2 / 4
    for name in numbers:
        if name in ROBOT.names:
            record[name] = numbers[name]
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
