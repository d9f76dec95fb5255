"""Wires of the reference simulator: routing by the law of cosines, bristle friction, elasticity with memory."""

from math import atan, cos, exp, log1p, sin, sqrt, tanh

from numba import njit

from exodrake.reference.records import (  # fmt: skip
    BRISTLE,
    CAPSTAN,
    CREEP_FAST,
    CREEP_SLOW,
    FELT_TENSION,
    GARMENT,
    MOUNT,
    PULLEY,
    ROUTER_SHIFT,
    THETA,
    WIRE_SHIFT,
)

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
def wound(p, wire, theta):
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
    length, radius = wound(p, wire, y[THETA + wire])
    stretch = (
        length
        - taken
        - p.slack[wire]
        - y[CREEP_FAST + wire]
        - y[CREEP_SLOW + wire]
        - y[GARMENT + wire]
        - y[MOUNT + wire]
    )
    tension = elastic(p, wire, stretch - u[WIRE_SHIFT + wire])
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
def rise_of_routers(p, y, u, wire):
    """Router lift [m] of one wire: follows the felt tension and saturates; plus a re-donning shift."""
    return u[ROUTER_SHIFT] + p.router_give[wire] * 12.0 * (1.0 - exp(-y[FELT_TENSION + wire] / 12.0))


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
    return rate - (force - held(force, level)) / SLIP_TIME


@njit(cache=True)
def held(force, level):
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
        tension -= held(force, level)
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


@njit(cache=True)
def at_pulley(p, y, wire, tension):
    """Friction of the sensing pulley in the wire [N], against which the motor pulls.

    The pulley turns on a plain bearing: the friction is proportional to the load, alike both ways.
    """
    return held(y[PULLEY + wire], 0.5 * FULL_TURN * p.pulley[wire] * tension)


@njit(cache=True)
def at_cell(p, y, dy, wire, tension, spool_speed):
    """Load on the cell [N]: the mean of the pulley's two strands, of which the farther one has the wire's tension."""
    if p.pulley[wire] == 0.0:
        return tension
    friction = 0.5 * FULL_TURN * p.pulley[wire]
    stiffness = friction * TYPICAL_LOAD / p.pulley_travel[wire]
    dy[PULLEY + wire] = rub_rate(y[PULLEY + wire], spool_speed, tension, friction * tension, stiffness)
    return tension + 0.5 * at_pulley(p, y, wire, tension)


@njit(cache=True)
def splay(p, y):
    """Cosine of the abduction angle that the all-flexor wire's tension causes; 1 in the plane."""
    return cos(atan(p.abduction * y[FELT_TENSION])) if p.abduction != 0.0 else 1.0
