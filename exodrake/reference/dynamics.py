"""The reference simulator's right-hand side: motor, wires, finger, cells; one derivative of one state vector."""

from math import cos, sin

import numpy as np
from numba import njit

from exodrake.reference import joint_torques as joints, tendons as paths
from exodrake.reference.chain import inverse_dynamics, mass_matrix
from exodrake.reference.records import (  # fmt: skip
    ANGLE,
    CELL,
    CELL_SECOND,
    COMMAND_LAG,
    INPUT_SIZE,
    INTEGRATOR,
    MOUNT,
    MOUNT_RATE,
    RATE,
    ROTOR,
    SUPPLY,
    THETA,
)

FRAME = 0.02
MOUNT_DAMPING = 0.02  # share of critical [A]


@njit(cache=True)
def inputs_at(p, inputs, time, u):
    """Time-varying inputs at one instant, linear between frames."""
    if p.has_inputs == 0.0:
        return
    place = max(0.0, time / FRAME)
    row = min(int(place), inputs.shape[0] - 2)
    share = min(1.0, place - row)
    for column in range(INPUT_SIZE):
        u[column] = inputs[row, column] + share * (inputs[row + 1, column] - inputs[row, column])


@njit(cache=True)
def current(p, y, u, wire, wanted):
    """Drive's current [A], limited by a clip, a soft clip or the back-EMF of a sagging supply.

    Returns:
        Current [A], and whether the integrator stands still.
    """
    raw = p.loop_p[wire] * wanted + y[INTEGRATOR + wire]
    limit = p.current_max[wire]
    if p.soft_limit[wire] > 0.0:
        limit = p.soft_limit[wire]
        frozen = abs(raw) > limit and raw * wanted > 0.0
        return raw / (1.0 + (raw / limit) ** 8) ** 0.125, frozen
    if p.supply_voltage > 0.0:
        volts = p.supply_voltage * (1.0 + u[SUPPLY])
        back = p.torque_constant[wire] * y[ROTOR + wire]
        headroom = (volts - (back if raw > 0.0 else -back)) / p.winding_resistance
        limit = min(limit, max(0.0, headroom))
    clipped = min(limit, max(-limit, raw))
    return clipped, clipped != raw and raw * wanted > 0.0


@njit(cache=True)
def shake(p, y, dy, wire, acceleration):
    """Lightly damped mount, kicked by the wire's acceleration [m/s2]; no static give."""
    pulsation = paths.FULL_TURN * p.mount_frequency[wire]
    dy[MOUNT + wire] = y[MOUNT_RATE + wire]
    back = pulsation * pulsation * y[MOUNT + wire] + 2.0 * MOUNT_DAMPING * pulsation * y[MOUNT_RATE + wire]
    dy[MOUNT_RATE + wire] = -p.mount_ratio[wire] * acceleration - back


@njit(cache=True)
def motor(p, y, dy, u, wire, command, tension, radius):
    """Rotor, gear angle, speed loop; the command [m/s] may pass an extra lag."""
    target = command * p.gear / p.spool_config
    if p.command_lag[wire] > 0.0:
        dy[COMMAND_LAG + wire] = (target - y[COMMAND_LAG + wire]) / p.command_lag[wire]
        target = y[COMMAND_LAG + wire]
    wanted = target - y[ROTOR + wire]
    amps, frozen = current(p, y, u, wire, wanted)
    leak = p.leak[wire] * y[INTEGRATOR + wire]
    dy[INTEGRATOR + wire] = (0.0 if frozen else p.loop_i[wire] * wanted) - leak
    load = radius * tension / p.gear
    torque = p.torque_constant[wire] * amps - p.damping[wire] * y[ROTOR + wire] - load
    dy[ROTOR + wire] = torque / p.inertia[wire]
    dy[THETA + wire] = y[ROTOR + wire] / p.gear
    if p.mount_frequency[wire] > 0.0:
        shake(p, y, dy, wire, radius * dy[ROTOR + wire] / p.gear)
    return dy[THETA + wire] * radius


@njit(cache=True)
def cell(p, y, dy, wire, load):
    """Load cell's filter; a slow one has two poles instead of one."""
    if p.cell_lag[wire] > 0.0:
        tau = 0.5 * p.cell_lag[wire]
        dy[CELL_SECOND + wire] = (load - y[CELL_SECOND + wire]) / tau
        dy[CELL + wire] = (y[CELL_SECOND + wire] - y[CELL + wire]) / tau
    else:
        dy[CELL + wire] = (load - y[CELL + wire]) / p.tau_cell


@njit(cache=True)
def route(p, y, u, wire, sine, cosine, arms):
    """Wire taken in by the finger [m]; fills the wire's row of moment arms [m]."""
    side = 1 if wire == 2 else 0
    rise = paths.rise_of_routers(p, y, u, wire)
    taken = 0.0
    for joint in range(1 if wire == 1 else 3):
        length, arm = paths.router(p, side, joint, sine[joint], cosine[joint], rise)
        if joint == 0:
            flat = paths.splay(p, y)
            length, arm = length * flat, arm * flat
        taken += length
        arms[wire, joint] = arm
    return taken


@njit(cache=True)
def wires(p, y, dy, u, command, torque, arms):
    """All three wires with their motors and cells; adds P^T T to the joint torques."""
    sine = (sin(y[ANGLE]), sin(y[ANGLE + 1]), sin(y[ANGLE + 2]))
    cosine = (cos(y[ANGLE]), cos(y[ANGLE + 1]), cos(y[ANGLE + 2]))
    first, second, first_speed, second_speed = 0.0, 0.0, 0.0, 0.0
    for wire in range(3):
        taken = route(p, y, u, wire, sine, cosine, arms)
        speed = arms[wire, 0] * y[RATE] + arms[wire, 1] * y[RATE + 1] + arms[wire, 2] * y[RATE + 2]
        tension, radius = paths.pull(p, y, dy, u, wire, taken)
        spool_speed = motor(p, y, dy, u, wire, command[wire], tension + paths.at_pulley(p, y, wire, tension), radius)
        cell(p, y, dy, wire, paths.at_cell(p, y, dy, wire, tension, spool_speed))
        at_finger = paths.through_sheath(p, y, dy, wire, tension, taken, speed)
        if wire == 0:
            first, first_speed = at_finger, speed
        elif wire == 1:
            second, second_speed = at_finger, speed
        for joint in range(3):
            torque[joint] += arms[wire, joint] * at_finger
    if p.rub > 0.0:
        rubbed = p.rub * min(first, second) * np.tanh((first_speed - second_speed) / 2e-3)
        for joint in range(3):
            torque[joint] += rubbed * (arms[1, joint] - arms[0, joint])


@njit(cache=True)
def accelerate(p, y, dy, torque):
    """Solve M q'' = torque - C q' + gravity for the three joints (Cramer's rule on the symmetric matrix)."""
    phi = (y[ANGLE], y[ANGLE] + y[ANGLE + 1], y[ANGLE] + y[ANGLE + 1] + y[ANGLE + 2])
    turn = (y[RATE], y[RATE] + y[RATE + 1], y[RATE] + y[RATE + 1] + y[RATE + 2])
    sine, cosine = (sin(phi[0]), sin(phi[1]), sin(phi[2])), (cos(phi[0]), cos(phi[1]), cos(phi[2]))
    (a, b, d), (_, e, f), (_, _, g) = mass_matrix(p, sine, cosine)
    bias = inverse_dynamics(p, sine, cosine, turn, (0.0, 0.0, 0.0), -p.gravity_x, -p.gravity_y)
    r0, r1, r2 = torque[0] - bias[0], torque[1] - bias[1], torque[2] - bias[2]
    k00, k01, k02 = e * g - f * f, d * f - b * g, b * f - d * e
    k11, k12, k22 = a * g - d * d, b * d - a * f, a * e - b * b
    determinant = a * k00 + b * k01 + d * k02
    dy[RATE] = (k00 * r0 + k01 * r1 + k02 * r2) / determinant
    dy[RATE + 1] = (k01 * r0 + k11 * r1 + k12 * r2) / determinant
    dy[RATE + 2] = (k02 * r0 + k12 * r1 + k22 * r2) / determinant


@njit(cache=True)
def derivative(time, y, dy, p, command, inputs, u, torque, arms):
    """dy/dt of the whole robot; u (inputs), torque (3,) and arms (3, 3) are scratch."""
    inputs_at(p, inputs, time, u)
    for joint in range(3):
        torque[joint] = joints.tissue(p, y, dy, u, joint) + joints.losses(p, y, dy, joint)
        torque[joint] += joints.wearer(p, y, u, joint, time) + joints.digital_tendon(p, y, joint)
        dy[ANGLE + joint] = y[RATE + joint]
    if p.contact_stiffness > 0.0:
        force, reach = joints.contact_force(p, y)
        for joint in range(3):
            torque[joint] += joints.contact_torque(force, reach, joint)
    wires(p, y, dy, u, command, torque, arms)
    accelerate(p, y, dy, torque)
