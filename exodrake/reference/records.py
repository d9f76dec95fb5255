"""Layout of the reference simulator: parameter record, state vector, time-varying inputs. SI throughout.

The state vector holds three values (AF, MF, AE or MCP, PIP, DIP) per quantity; a quantity no effect uses simply
stays at rest.
"""

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
