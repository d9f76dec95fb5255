"""The reference simulator's compiled functions: one derivative of the whole robot, its integrator, its frames.

The finger is a planar chain of three phalanges by recursive Newton-Euler (Luh, Walker, Paul 1980). x is distal, y
dorsal; a joint angle > 0 flexes, i.e. turns about -z. A phalanx at absolute angle phi points along (cos phi, -sin phi).
Wires are routed by the law of cosines, with bristle friction and an elasticity with memory. Joint torques are in N m
along +q: tissue, losses, contact, the wearer.

The integrator is a stabilised Runge-Kutta-Chebyshev pair with error control, restarted at every task (Sommeijer,
Shampine and Verwer, J. Comput. Appl. Math. 88, 1998). The robot is stiff in a simple way: joint damping on light
phalanges makes one real rate of about -12000 1/s, the rest is slower than 1000 1/s. A step of 2 ms costs eight slopes,
no Jacobian; LSODA's memory would cost a hundred times as much in such short slots.

All are in this file, since numba's cache sees changes of the file of a function alone.
"""

from math import atan, ceil, cos, cosh, exp, log1p, sin, sinh, sqrt, tanh

import numpy as np
from numba import njit

FRAME = 0.02  # s
# The state vector holds three values (AF, MF, AE or MCP, PIP, DIP) per quantity; one that no effect uses stays at rest.
# quantity -> absolute tolerance of the integrator [SI], well below what the comparison with the reference resolves
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
STATE_SIZE = 3 * len(TOLERANCES)
ROTOR, THETA, INTEGRATOR, CELL, CELL_SECOND, COMMAND_LAG, CAPSTAN, BRISTLE = range(0, 24, 3)
CREEP_FAST, CREEP_SLOW, GARMENT, PULLEY, MOUNT, MOUNT_RATE, FELT_TENSION = range(24, 45, 3)
ANGLE, RATE, RELAX_FAST, RELAX_SLOW, JOINT_LOSS = range(45, 60, 3)

# Inputs that change over time, one column each, linear between frames.
REST_SHIFT, VOLUNTARY, STIFFENED, TREMOR_PHASE, WIRE_SHIFT, SUPPLY = 0, 3, 6, 9, 10, 13
ROUTER_SHIFT, CELL_DRIFT, MARKER_SHIFT, INPUT_SIZE = 14, 15, 18, 21

# Fields of the parameter record: values of the whole robot, of each wire or joint, of each side and joint.
_SCALARS = """
    tau_cell kp kd speed_max spool_config gear growth_pitch capstan_travel stribeck_speed viscous_speed
    bristle_stiffness bristle_damping contact_depth contact_stiffness tremor_torque tremor_frequency gravity_x
    gravity_y abduction notch_angle notch_width notch_torque snag_force snag_place snag_width rub latency
    supply_voltage winding_resistance slip_rate slip_load has_inputs hysteresis_power quantum_force sticky
    mocap_delay mocap_skew
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


@njit(cache=True)
def inverse_dynamics(p, sine, cosine, turn, spin, base_x, base_y):
    """Joint torques [N m] of a motion: sines and cosines of absolute angles, their rates and accelerations (3,) each.

    The base is the distal and dorsal acceleration of the first joint [m/s2]; minus gravity for a finger with weight.
    """
    x, y, force_x, force_y = base_x, base_y, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(3):  # accelerations, outwards, by the second derivative of each phalanx's direction [1/s2]
        swing_x = -spin[i] * sine[i] - turn[i] * turn[i] * cosine[i]
        swing_y = -spin[i] * cosine[i] + turn[i] * turn[i] * sine[i]
        force_x = force_x[1], force_x[2], p.mass[i] * (x + p.centre[i] * swing_x)
        force_y = force_y[1], force_y[2], p.mass[i] * (y + p.centre[i] * swing_y)
        x, y = x + p.length[i] * swing_x, y + p.length[i] * swing_y
    torque, beyond_x, beyond_y, torques = 0.0, 0.0, 0.0, (0.0, 0.0, 0.0)
    for i in (2, 1, 0):  # torques, inwards: the phalanx's own force, and that of the phalanges beyond
        torque += p.mass[i] * (p.unit_inertia[i] - p.centre[i] * p.centre[i]) * spin[i]
        own, beyond = sine[i] * force_x[i] + cosine[i] * force_y[i], sine[i] * beyond_x + cosine[i] * beyond_y
        torque -= p.centre[i] * own + p.length[i] * beyond
        beyond_x, beyond_y = beyond_x + force_x[i], beyond_y + force_y[i]
        torques = torque, torques[0], torques[1]
    return torques


@njit(cache=True)
def mass_matrix(p, sine, cosine):
    """Columns of the mass matrix [kg m2]: torques of unit accelerations of one joint each, from rest."""
    still = (0.0, 0.0, 0.0)
    first = inverse_dynamics(p, sine, cosine, still, (1.0, 1.0, 1.0), 0.0, 0.0)
    second = inverse_dynamics(p, sine, cosine, still, (0.0, 1.0, 1.0), 0.0, 0.0)
    return first, second, inverse_dynamics(p, sine, cosine, still, (0.0, 0.0, 1.0), 0.0, 0.0)


FULL_TURN = 6.283185307179586
TYPICAL_LOAD, LIGHTEST = 4.0, 0.2  # N; a polymer sheath's friction coefficient falls slowly with load [A]
SLIP_TIME = 2e-3  # s, over which a contact lets go of what its load no longer holds [A]


@njit(cache=True)
def router(p, side, joint, sine, cosine, rise):
    """Wire taken in [m] and moment arm [m] at one joint; side 0 palmar, 1 dorsal; rise [m] lifts both routers.

    Law of cosines between the two routers seen from the joint centre (physics.md 1.1 for the geometry).
    """
    sign = 1.0 - 2.0 * side
    distal, proximal = p.height_distal[side, joint] + rise, p.height_proximal[side, joint] + rise
    along, across = p.axial_distal[side, joint], p.axial_proximal[side, joint]
    dot = along * across - distal * proximal
    cross = distal * across + along * proximal
    squares = along * along + distal * distal + across * across + proximal * proximal
    distance = sqrt(squares + 2.0 * (dot * cosine - sign * cross * sine))
    return p.straight[side, joint] - distance, (dot * sine + sign * cross * cosine) / distance


@njit(cache=True)
def wind(p, wire, theta):
    """Wire on the spool [m] and its radius there [m] at gear angle theta; layers build up like a softened staircase."""
    radius = p.spool[wire]
    straight = radius * theta
    length, local = straight, radius
    if p.growth[wire] != 0.0:
        wave = FULL_TURN / p.growth_pitch
        grown = 0.5 * straight * straight + 0.8 / (wave * wave) * (1.0 - cos(wave * straight))
        length += p.growth[wire] * grown
        local += radius * p.growth[wire] * (straight + 0.8 / wave * sin(wave * straight))
    if p.eccentricity[wire] != 0.0:
        phase = p.eccentric_phase[wire]
        length += radius * p.eccentricity[wire] * (sin(theta + phase) - sin(phase))
        local += radius * p.eccentricity[wire] * cos(theta + phase)
    return length, local


@njit(cache=True)
def elastic(p, wire, stretch):
    """Tension [N] of a stretched wire: straight line, toe (hyperbola) or parabola."""
    stiffness = p.wire_stiffness[wire]
    if p.toe[wire] > 0.0:
        return stiffness * 0.5 * (stretch + sqrt(stretch * stretch + p.toe[wire] ** 2))
    if stretch <= 0.0:
        return 0.0
    if p.stiffening[wire] > 0.0:
        return stiffness * stretch * (1.0 + 0.5 * p.stiffening[wire] * stretch)
    return stiffness * stretch


@njit(cache=True)
def pull(p, y, dy, u, wire, taken):
    """Tension at the cell [N] and spool radius [m]; writes the rates of creep, garment and felt tension."""
    length, radius = wind(p, wire, y[THETA + wire])
    stretch = length - taken - p.slack[wire] - y[CREEP_FAST + wire] - y[CREEP_SLOW + wire]
    tension = elastic(p, wire, stretch - y[GARMENT + wire] - y[MOUNT + wire] - u[WIRE_SHIFT + wire])
    if p.creep[wire] > 0.0:
        share = 0.5 * tension / p.creep[wire]
        dy[CREEP_FAST + wire] = (share - y[CREEP_FAST + wire]) * 3.0 / p.creep_time[wire]
        dy[CREEP_SLOW + wire] = (share - y[CREEP_SLOW + wire]) / (1.7 * p.creep_time[wire])
    if p.garment[wire] > 0.0:
        give = y[GARMENT + wire]
        resist = p.garment[wire] * give * (1.0 + p.garment_stiffening[wire] * abs(give))
        dy[GARMENT + wire] = (tension - resist) / (0.003 * (p.wire_stiffness[wire] + p.garment[wire]))
    if p.slip_rate > 0.0:  # the same state, but nothing pulls it back
        dy[GARMENT + wire] = p.slip_rate * max(0.0, tension - p.slip_load)
    if p.router_give[wire] != 0.0 or p.abduction != 0.0:
        dy[FELT_TENSION + wire] = (tension - y[FELT_TENSION + wire]) / 0.02
    return tension, radius


@njit(cache=True)
def rub_rate(force, speed, tension, level, stiffness):
    """Rate [N/s] of the force that an elastic contact holds, whose level [N] follows the tension [N].

    Ductile Dahl law (exponent 3/2) of constant stiffness [N/m]: the energy that it stores, force^2 / (2 stiffness), is
    the same at every tension, so no course of tension and motion gains work. What the tension no longer holds is let
    go, as all of it is where the wire is nearly slack.
    """
    if tension < LIGHTEST:
        return -force / SLIP_TIME
    left = 1.0 - (force if speed > 0.0 else -force) / level
    rate = stiffness * speed * left * sqrt(left) if left > 0.0 else 0.0
    return rate - (force - limit_force(force, level)) / SLIP_TIME


@njit(cache=True)
def limit_force(force, level):
    """What of a force acts [N] where friction holds no more than `level` [N]."""
    return min(max(force, -level), level)


@njit(cache=True)
def through_sheath(p, y, dy, wire, tension, taken, speed):
    """Tension at the finger [N] after the losses in the sheath; writes bristle rates.

    The losses: capstan (Dahl), Coulomb and Stribeck (LuGre), viscous (shear-thinning), and a snag.
    """
    if p.capstan[wire] > 0.0:
        force = y[CAPSTAN + wire]
        angle = p.capstan[wire] * (max(tension, LIGHTEST) / TYPICAL_LOAD) ** -0.1
        level = tension * (1.0 - exp(-angle) if force > 0.0 else exp(angle) - 1.0)
        stiffness = p.capstan[wire] * TYPICAL_LOAD / p.capstan_travel
        dy[CAPSTAN + wire] = rub_rate(force, speed, tension, level, stiffness)
        tension -= limit_force(force, level)
    loss = 0.0
    if p.coulomb[wire] > 0.0:
        z = y[BRISTLE + wire]
        level = p.coulomb[wire]
        if p.static[wire] > level:
            level += (p.static[wire] - level) * exp(-abs(speed) / p.stribeck_speed)
        dz = speed - p.bristle_stiffness * abs(speed) / level * z
        dy[BRISTLE + wire] = dz
        loss += p.bristle_stiffness * z + p.bristle_damping * dz
    if p.viscous[wire] > 0.0:
        size = abs(speed) / p.viscous_speed
        loss += p.viscous[wire] * p.viscous_speed * log1p(size) * (1.0 if speed > 0.0 else -1.0)
    if p.snag_force > 0.0 and wire == 0:
        near = (taken - p.snag_place) / p.snag_width
        loss += p.snag_force * exp(-near * near) * max(0.0, tanh(speed / 1e-3))
    return max(0.0, tension - loss)


SINH_RATE = 1.6  # 1/rad, bends the exponential hardening away from a cubic [A]


@njit(cache=True)
def tissue(p, y, dy, u, joint):
    """Spring, damper, end stops, hardening (sinh), two relaxing branches."""
    q, rate = y[ANGLE + joint], y[RATE + joint]
    bent = q - p.rest[joint] - u[REST_SHIFT + joint]
    stiffness, torque = p.stiffness_joint[joint] * p.factor[joint] * (1.0 + u[STIFFENED + joint]), 0.0
    if q > p.stop_flexed[joint]:  # double exponential, physics.md
        torque -= p.stop_torque[joint] * (exp(p.stop_rate[joint] * (q - p.stop_flexed[joint])) - 1.0)
    if q < p.stop_extended[joint]:
        torque += p.stop_torque[joint] * (exp(p.stop_rate[joint] * (p.stop_extended[joint] - q)) - 1.0)
    torque = torque - stiffness * bent - p.damping_joint[joint] * rate
    if p.hardening[joint] > 0.0:
        scale = 6.0 * p.hardening[joint] / SINH_RATE**3
        torque -= scale * (sinh(SINH_RATE * bent) - SINH_RATE * bent)
    if p.relaxing[joint] > 0.0:
        dy[RELAX_FAST + joint] = (bent - y[RELAX_FAST + joint]) * 3.0 / p.relaxing_time[joint]
        dy[RELAX_SLOW + joint] = (bent - y[RELAX_SLOW + joint]) / (1.7 * p.relaxing_time[joint])
        branch = 0.5 * stiffness * p.relaxing[joint]
        torque -= branch * (2.0 * bent - y[RELAX_FAST + joint] - y[RELAX_SLOW + joint])
    return torque


@njit(cache=True)
def losses(p, y, dy, joint):
    """Bouc-Wen hysteresis; its level may grow with the joint angle (posture-dependent friction)."""
    level = p.loss[joint]
    if p.loss_by_angle[joint] > 0.0:
        level += p.loss_by_angle[joint] * max(0.0, y[ANGLE + joint]) ** 2
    if level <= 0.0:
        return 0.0
    z, rate = y[JOINT_LOSS + joint], y[RATE + joint]
    back = abs(z) ** p.hysteresis_power * (0.5 * rate + 0.5 * abs(rate) * (1.0 if z > 0.0 else -1.0))
    dy[JOINT_LOSS + joint] = (rate - back) / p.loss_width[joint]
    return -level * z


@njit(cache=True)
def wearer(p, y, u, joint, time):
    """Tremor with a wandering phase, voluntary bursts, catch in fast flexion (softened ramp), snap-through notch."""
    torque = u[VOLUNTARY + joint]
    if p.tremor_torque > 0.0:
        phase = FULL_TURN * p.tremor_frequency * time + u[TREMOR_PHASE]
        torque += p.tremor_torque * p.tremor_share[joint] * (sin(phase) + 0.15 * sin(2.0 * phase))
    if p.spastic_gain[joint] > 0.0:
        softness = 0.15 * p.spastic_threshold[joint]
        over = (y[RATE + joint] - p.spastic_threshold[joint]) / softness
        ramp = over if over > 30.0 else log1p(exp(over))
        torque -= p.spastic_gain[joint] * softness * ramp
    if p.notch_torque != 0.0 and joint == 1:
        x = (y[ANGLE + joint] - p.notch_angle) / p.notch_width
        torque += p.notch_torque * x / cosh(x) ** 2
    return torque


MOUNT_DAMPING = 0.02  # share of critical [A]


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
    if p.mount_frequency[wire] > 0.0:  # lightly damped mount, kicked by the wire's acceleration; no static give
        pulsation = FULL_TURN * p.mount_frequency[wire]
        dy[MOUNT + wire] = y[MOUNT_RATE + wire]
        back = pulsation * pulsation * y[MOUNT + wire] + 2.0 * MOUNT_DAMPING * pulsation * y[MOUNT_RATE + wire]
        dy[MOUNT_RATE + wire] = -p.mount_ratio[wire] * (radius * dy[ROTOR + wire] / p.gear) - back
    return dy[THETA + wire] * radius


@njit(cache=True)
def route(p, y, u, wire, sine, cosine, arms):
    """Wire taken in by the finger [m]; fills the wire's row of moment arms [m].

    The routers' lift follows the felt tension and saturates; a re-donning shift adds to it.
    """
    side = 1 if wire == 2 else 0
    rise = u[ROUTER_SHIFT] + p.router_give[wire] * 12.0 * (1.0 - exp(-y[FELT_TENSION + wire] / 12.0))
    taken = 0.0
    for joint in range(1 if wire == 1 else 3):
        length, arm = router(p, side, joint, sine[joint], cosine[joint], rise)
        if joint == 0 and p.abduction != 0.0:  # by an angle that the all-flexor wire's tension causes
            flat = cos(atan(p.abduction * y[FELT_TENSION]))
            length, arm = length * flat, arm * flat
        taken += length
        arms[wire, joint] = arm
    return taken


@njit(cache=True)
def wires(p, y, dy, u, command, torque, arms):
    """All three wires with their motors and cells; adds P^T T to the joint torques."""
    sine = (sin(y[ANGLE]), sin(y[ANGLE + 1]), sin(y[ANGLE + 2]))
    cosine = (cos(y[ANGLE]), cos(y[ANGLE + 1]), cos(y[ANGLE + 2]))
    pulls, speeds = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)  # at the finger
    for wire in range(3):
        taken = route(p, y, u, wire, sine, cosine, arms)
        speed = arms[wire, 0] * y[RATE] + arms[wire, 1] * y[RATE + 1] + arms[wire, 2] * y[RATE + 2]
        tension, radius = pull(p, y, dy, u, wire, taken)
        # of the sensing pulley, on a plain bearing: friction proportional to the load, against which the motor pulls
        friction = 0.5 * FULL_TURN * p.pulley[wire]
        drag = limit_force(y[PULLEY + wire], friction * tension)
        spool_speed = motor(p, y, dy, u, wire, command[wire], tension + drag, radius)
        if p.pulley[wire] != 0.0:
            stiffness = friction * TYPICAL_LOAD / p.pulley_travel[wire]
            dy[PULLEY + wire] = rub_rate(y[PULLEY + wire], spool_speed, tension, friction * tension, stiffness)
        load = tension + 0.5 * drag  # on the cell: the mean of the pulley's strands, the farther one at `tension`
        if p.cell_lag[wire] > 0.0:  # a slow filter has two poles instead of one
            tau = 0.5 * p.cell_lag[wire]
            dy[CELL_SECOND + wire] = (load - y[CELL_SECOND + wire]) / tau
            dy[CELL + wire] = (y[CELL_SECOND + wire] - y[CELL + wire]) / tau
        else:
            dy[CELL + wire] = (load - y[CELL + wire]) / p.tau_cell
        pulls = pulls[1], pulls[2], through_sheath(p, y, dy, wire, tension, taken, speed)
        speeds = speeds[1], speeds[2], speed
        for joint in range(3):
            torque[joint] += arms[wire, joint] * pulls[2]
    if p.rub > 0.0:
        rubbed = p.rub * min(pulls[0], pulls[1]) * np.tanh((speeds[0] - speeds[1]) / 2e-3)
        for joint in range(3):
            torque[joint] += rubbed * (arms[1, joint] - arms[0, joint])


@njit(cache=True)
def derivative(time, y, dy, p, command, inputs, u, torque, arms):
    """dy/dt of the whole robot; u (inputs), torque (3,) and arms (3, 3) are scratch."""
    if p.has_inputs != 0.0:  # linear between frames
        place = max(0.0, time / FRAME)
        row = min(int(place), inputs.shape[0] - 2)
        share = min(1.0, place - row)
        for column in range(INPUT_SIZE):
            u[column] = inputs[row, column] + share * (inputs[row + 1, column] - inputs[row, column])
    for joint in range(3):
        torque[joint] = tissue(p, y, dy, u, joint) + losses(p, y, dy, joint)
        tied = 0.0
        if p.coupling[2] != 0.0 and joint != 0:  # DIP to PIP, slightly hardening; equal and opposite work at the PIP
            apart = y[ANGLE + 2] - p.coupling_ratio[2] * y[ANGLE + 1]
            pull_back = p.coupling[2] * apart * (1.0 + 0.5 * apart * apart)
            tied = -pull_back if joint == 2 else p.coupling_ratio[2] * pull_back
        torque[joint] += wearer(p, y, u, joint, time) + tied
        dy[ANGLE + joint] = y[RATE + joint]
    phi = (y[ANGLE], y[ANGLE] + y[ANGLE + 1], y[ANGLE] + y[ANGLE + 1] + y[ANGLE + 2])
    turn = (y[RATE], y[RATE] + y[RATE + 1], y[RATE] + y[RATE + 1] + y[RATE + 2])
    sine, cosine = (sin(phi[0]), sin(phi[1]), sin(phi[2])), (cos(phi[0]), cos(phi[1]), cos(phi[2]))
    if p.contact_stiffness > 0.0:  # of the fingertip with an object: Hunt-Crossley with exponent 1.3
        into = p.length[0] * sine[0] + p.length[1] * sine[1] + p.length[2] * sine[2] - p.contact_depth
        if into > 0.0:
            reach = (p.length[0] * cosine[0], p.length[1] * cosine[1], p.length[2] * cosine[2])
            speed = reach[0] * turn[0] + reach[1] * turn[1] + reach[2] * turn[2]
            force, arm = p.contact_stiffness * 1e-3 * (into / 1e-3) ** 1.3 * (1.0 + 1.5 * speed), 0.0
            for joint in (2, 1, 0):
                arm += reach[joint]
                torque[joint] -= max(0.0, force) * arm
    wires(p, y, dy, u, command, torque, arms)
    # M q'' = torque - C q' + gravity, by Cramer's rule on the symmetric matrix
    (a, b, d), (_, e, f), (_, _, g) = mass_matrix(p, sine, cosine)
    bias = inverse_dynamics(p, sine, cosine, turn, (0.0, 0.0, 0.0), -p.gravity_x, -p.gravity_y)
    r0, r1, r2 = torque[0] - bias[0], torque[1] - bias[1], torque[2] - bias[2]
    k00, k01, k02 = e * g - f * f, d * f - b * g, b * f - d * e
    k11, k12, k22 = a * g - d * d, b * d - a * f, a * e - b * b
    determinant = a * k00 + b * k01 + d * k02
    dy[RATE] = (k00 * r0 + k01 * r1 + k02 * r2) / determinant
    dy[RATE + 1] = (k01 * r0 + k11 * r1 + k12 * r2) / determinant
    dy[RATE + 2] = (k02 * r0 + k12 * r1 + k22 * r2) / determinant


RELATIVE = 1e-3  # tolerance of the integrator
RADIUS = 1.5e4  # 1/s, guess of the spectral radius, with a margin for drawn parameters
DAMPING = 2.0 / 13.0  # of the Chebyshev polynomials, as in the paper
SAFETY, SHRINK, GROW = 0.8, 0.1, 5.0
SMALLEST = 1e-9  # s
TOLERANCE = np.repeat(list(TOLERANCES.values()), 3)  # (STATE_SIZE,) absolute tolerances [SI]


@njit(cache=True)
def chebyshev(w0, before, last):
    """Next T, T', T'' at w0 from the last two."""
    value = 2.0 * w0 * last[0] - before[0]
    slope = 2.0 * w0 * last[1] - before[1] + 2.0 * last[0]
    return value, slope, 2.0 * w0 * last[2] - before[2] + 4.0 * last[1]


@njit(cache=True)
def trial(time, y, step, p, command, inputs, work):
    """One RKC step from slope work[0]; the index of the row that holds the new state. Its slope is not yet known."""
    rows, u, torque, arms = work
    start, slope = rows[0], rows[1]
    stages = max(2, 1 + ceil(sqrt(1.0 + 1.54 * step * RADIUS)))
    w0 = 1.0 + DAMPING / stages**2
    before, last = (1.0, 0.0, 0.0), (w0, 1.0, 0.0)
    for _ in range(2, stages + 1):
        before, last = last, chebyshev(w0, before, last)
    w1 = last[1] / last[2]
    before, last = (1.0, 0.0, 0.0), (w0, 1.0, 0.0)
    b_first = 1.0 / (4.0 * w0 * w0)  # b0 = b1 = b2
    b_older, b_old = b_first, b_first
    older, old, new = 2, 3, 4
    moment = b_first * w1
    for i in range(y.size):
        rows[older, i] = y[i]
        rows[old, i] = y[i] + moment * step * start[i]
    for _ in range(2, stages + 1):
        derivative(time + moment * step, rows[old], slope, p, command, inputs, u, torque, arms)
        gone = 1.0 - b_old * last[0]
        before, last = last, chebyshev(w0, before, last)
        b = last[2] / (last[1] * last[1])
        reach = 2.0 * b * w1 / b_old
        mu, nu = 2.0 * b * w0 / b_old, -b / b_older
        rest, first, second = 1.0 - mu - nu, reach * step, -gone * reach * step
        for i in range(y.size):
            mixed = rest * y[i] + mu * rows[old, i] + nu * rows[older, i]
            rows[new, i] = mixed + first * slope[i] + second * start[i]
        moment = w1 * last[2] / last[1]
        b_older, b_old = b_old, b
        older, old, new = old, new, older
    return old


@njit(cache=True)
def advance(time, until, y, step, p, command, inputs, tolerance, work):
    """Integrate y in place from time to until [s]; returns the step to try next, or -1 if it cannot be done."""
    rows, u, torque, arms = work
    derivative(time, y, rows[0], p, command, inputs, u, torque, arms)
    left = until - time
    while left > SMALLEST:
        size = min(step, left)
        if size > 0.5 * left and size < left:
            size = 0.5 * left
        new = rows[trial(time, y, size, p, command, inputs, work)]
        derivative(time + size, new, rows[5], p, command, inputs, u, torque, arms)
        worst = 0.0  # error in units of what is tolerated
        for i in range(y.size):
            error = 0.8 * (y[i] - new[i]) + 0.4 * size * (rows[0, i] + rows[5, i])
            worst = max(worst, abs(error) / (tolerance[i] + RELATIVE * abs(new[i])))
        worst = worst if worst < 1e12 else 1e12
        factor = min(GROW, max(SHRINK, SAFETY * (worst + 1e-10) ** (-1.0 / 3.0)))
        if worst <= 1.0:
            time += size
            left = until - time
            for i in range(y.size):
                y[i], rows[0, i] = new[i], rows[5, i]
            step = max(step, size * factor) if size < step else size * factor
        else:
            step = size * factor
            if step < SMALLEST:
                return -1.0
    return step


SLOT = 0.002
FULL_SCALE = 20.0  # N, where the cell's bow returns to zero (effects.md)


@njit(cache=True)
def cell_reading(p, y, wire, drift, noise, before):
    """What the bus delivers [N]: neighbour, scale, bow (skewed half sine), zero, drift, noise, sticking, rounding."""
    load = y[CELL + wire] + p.crosstalk[wire] * y[CELL + (wire + 1) % 3]
    reading = (1.0 + p.cell_gain[wire]) * load + p.cell_offset[wire] + drift + noise
    reading += p.cell_bow[wire] * np.sin(np.pi * (max(load, 0.0) / FULL_SCALE) ** 0.8)
    if p.sticky > 0.0 and abs(reading - before) < p.sticky:
        return before
    if p.quantum_force > 0.0:
        reading = np.round(reading / p.quantum_force) * p.quantum_force
    return reading


@njit(cache=True)
def run(p, y, reference, inputs, dropped, noise, tolerance):
    """Simulate n frames of a robot from its state y, on references (n, 3) [N] with the noise (n, 3) [N] of its cells.

    Tension (n, 3) [N], gear angle (n, 3) [rad], commands (n, 3) [m/s], and angles and rates (10 n, 6) [rad, rad/s] at
    every mid-slot; NaN from where a state cannot be integrated.
    """
    frames = reference.shape[0]
    tension, theta = np.full((frames, 3), np.nan), np.full((frames, 3), np.nan)
    commands, posture = np.full((frames, 3), np.nan), np.full((10 * frames, 6), np.nan)
    active, awake, last = np.zeros(3), np.zeros(3, np.bool_), np.zeros(3)
    # scratch: slope at the start, slope of a stage, three stages, new state; inputs, torque, arms
    work = np.zeros((6, y.size)), np.zeros(INPUT_SIZE), np.zeros(3), np.zeros((3, 3))
    step, time = 1e-4, 0.0
    for frame in range(frames):
        for slot in range(10):
            until = frame * FRAME + slot * SLOT + 0.5 * SLOT
            step = advance(time, until, y, step, p, active, inputs, tolerance, work)
            if step < 0.0:
                return tension, theta, commands, posture
            time = until
            for i in range(3):
                posture[10 * frame + slot, i], posture[10 * frame + slot, 3 + i] = y[ANGLE + i], y[RATE + i]
            if 1 <= slot <= 3:
                wire, drift = slot - 1, inputs[frame, CELL_DRIFT + slot - 1]
                theta[frame, wire] = y[THETA + wire]
                tension[frame, wire] = cell_reading(p, y, wire, drift, noise[frame, wire], last[wire])
            elif slot == 4:
                for wire in range(3):  # admittance law with the damping sign [m/s]
                    reading = tension[frame, wire]
                    change = 0.0 if frame == 0 else (reading - last[wire]) / FRAME
                    command = p.kp * (reference[frame, wire] - reading) - p.kd * change
                    commands[frame, wire] = min(p.speed_max, max(-p.speed_max, command))
                    last[wire] = reading
            elif 5 <= slot <= 7 and not dropped[frame, slot - 5]:
                wire, sent = slot - 5, frame - int(p.latency)  # before the first frame the command is 0
                command = commands[sent, wire] if sent >= 0 else 0.0
                if p.dead_zone[wire] > 0.0:  # small ones are ignored, with hysteresis in waking up and falling asleep
                    awake[wire] = abs(command) > p.dead_zone[wire] * (0.8 if awake[wire] else 1.2)
                    command = command if awake[wire] else 0.0
                active[wire] = command
    return tension, theta, commands, posture
