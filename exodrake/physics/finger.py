"""Planar 3R chain of solid cylinders with passive joints: inertia, Coriolis and passive torques.

In absolute angles phi_i = q_1 + .. + q_i the chain is A(phi) phi'' + c(phi, phi') = Q with constant A_ii,
A_ij = b_ij cos(phi_i - phi_j) and c_i = sum_j b_ij sin(phi_i - phi_j) phi_j'^2; a joint's row is the sum over the bones
distal to it. Passive torque (`physics.md`, Finger):

    tau_p = kappa (q - q0) + A (exp(beta (q - q_f)) - 1) [q > q_f] - A (exp(beta (q_e - q)) - 1) [q < q_e]
"""

import sys
from math import exp

from exodrake.model.part import JOINTS, SCALAR, FreeLaw, Point, free_memory
from exodrake.physics.arithmetic import quotient

NUDGE = 1e-6  # of difference quotients [rad]
HERE = sys.modules[__name__]
AGAINST = "rate / (abs(rate) + 0.05)"  # direction of a joint, blurred over a slow turn [rad/s]: assumed

passive = Point(
    "passive", JOINTS, "torque, bend, rate, elastic, clock",
    "passive torque [N m] at joint i, against flexion; bend: q - q0 [rad]; elastic: kappa (q - q0) [N m]", module=HERE,
    laws=(
        FreeLaw("torque over bend", "bend", "rad"),
        FreeLaw("torque over rate", "rate", "rad/s", fine=True),
        FreeLaw("friction over bend", "bend", "rad", AGAINST),
        FreeLaw("torque over time", "clock", "s"),
        FreeLaw("stiffness over time", "clock", "s", "elastic"),
        *free_memory("of torque over bend", "bend", "rad", "relax"),
    ),
)  # fmt: skip
external = Point(
    "external", SCALAR, "torque, angle, rate, bones, clock",
    "torques from outside on the three joints [N m]; bones: (lengths [m], moments m c [kg m]); clock [s]",
    laws=(), module=HERE,
)  # fmt: skip
relax = Point("relax", JOINTS, "dt, bend, rate, elastic", "states of the effects at joint i after dt [s]", (), HERE)


def inertia(length, mass, radius):
    """Constants of the chain: A_ii [kg m2], (b_12, b_13, b_23) [kg m2] and the bones' first moments [kg m].

    The first moment of bone i is m_i c_i + (mass distal to it) L_i, c_i = L_i / 2.
    """
    own = (0.5 * mass[0] * length[0], 0.5 * mass[1] * length[1], 0.5 * mass[2] * length[2])
    beyond = (mass[1] + mass[2], mass[2], 0.0)
    moments = (own[0] + beyond[0] * length[0], own[1] + beyond[1] * length[1], own[2])
    first = cylinder(length[0], mass[0], radius[0]) + beyond[0] * length[0] * length[0]
    second = cylinder(length[1], mass[1], radius[1]) + beyond[1] * length[1] * length[1]
    diagonal = (first, second, cylinder(length[2], mass[2], radius[2]))
    return diagonal, (moments[1] * length[0], moments[2] * length[0], moments[2] * length[1]), moments


def cylinder(length, mass, radius):
    """Inertia of a solid cylinder about a transverse axis through its end [kg m2]."""
    return mass * (radius * radius / 4.0 + length * length / 3.0)


def mass_matrix(diagonal, coupling, cos_1, cos_2, cos_12):
    """M(q) [kg m2] as its upper triangle (11, 12, 13, 22, 23, 33); cosines of q_PIP, q_DIP and their sum."""
    a12, a13, a23 = coupling[0] * cos_1, coupling[1] * cos_12, coupling[2] * cos_2
    m33 = diagonal[2]
    m23 = m33 + a23
    m22 = m23 + a23 + diagonal[1]
    m13 = m23 + a13
    m12 = m22 + a12 + a13
    return m12 + diagonal[0] + a12 + a13, m12, m13, m22, m23, m33


def coriolis(coupling, sin_1, sin_2, sin_12, rate):
    """C(q, q') q' [N m]; sines of q_PIP, q_DIP and their sum."""
    w1 = rate[0] * rate[0]
    turned = rate[0] + rate[1]
    w2 = turned * turned
    turned += rate[2]
    w3 = turned * turned
    s12, s13, s23 = coupling[0] * sin_1, coupling[1] * sin_12, coupling[2] * sin_2
    c1 = -s12 * w2 - s13 * w3
    c2 = s12 * w1 - s23 * w3
    c3 = s13 * w1 + s23 * w2
    return c1 + c2 + c3, c2 + c3, c3


def end_stop(angle, q_f, q_e, beta, a):
    """Torque of the tissue near the ends of the range [N m]."""
    if angle > q_f:
        return a * (exp(beta * (angle - q_f)) - 1.0)
    if angle < q_e:
        return -a * (exp(beta * (q_e - angle)) - 1.0)
    return 0.0


def passive_torque(e, z, i, angle, rate, clock, n):
    """Torque at joint i that resists flexion, without damping [N m]."""
    bend = angle - n.q0[i]
    elastic = n.kappa[i] * bend
    torque = elastic + end_stop(angle, n.q_f[i], n.q_e[i], n.beta[i], n.A[i])
    return passive(e, z, i, torque, bend, rate, elastic, clock)


def passive_with_slope(e, z, i, n, angle, rate, clock, lag):
    """Passive torque [N m] at joint i and its slope [N m/rad] along angle' = lag rate', as a tick moves both."""
    torque = passive_torque(e, z, i, angle, rate, clock, n)
    return torque, (passive_torque(e, z, i, angle + NUDGE, rate + NUDGE / lag, clock, n) - torque) / NUDGE


def external_with_slope(e, z, n, angle, rate, moments, clock, lag):
    """External torques [N m] and columns of their slope by angle [N m/rad], the rates moving along with the angles."""
    nothing, bones, quick = (0.0, 0.0, 0.0), (n.length, moments), NUDGE / lag
    (q0, q1, q2), (w0, w1, w2) = angle, rate
    here = external(e, z, nothing, angle, rate, bones, clock)
    if here == nothing:
        return here, (nothing, nothing, nothing)
    c0 = external(e, z, nothing, (q0 + NUDGE, q1, q2), (w0 + quick, w1, w2), bones, clock)
    c1 = external(e, z, nothing, (q0, q1 + NUDGE, q2), (w0, w1 + quick, w2), bones, clock)
    c2 = external(e, z, nothing, (q0, q1, q2 + NUDGE), (w0, w1, w2 + quick), bones, clock)
    return here, (quotient(here, c0, NUDGE), quotient(here, c1, NUDGE), quotient(here, c2, NUDGE))
