"""Posture of the nominal finger at rest under given wire tensions: P(q)^T T = tau_p(q), solved per joint.

A wire's moment arm at a joint depends on that joint's angle alone, so the three equations are independent:

    sum_j T_j R_ji(q_i) = kappa_i (q_i - q0_i) + end_stop(q_i)

Parameters are those of `physics.tendon_finger` (same functions, compiled here): wires AF, MF, AE; joints MCP, PIP, DIP.
"""

from math import cos, sin
from typing import Any

import numpy as np
from numba import njit

from exodrake.model.robot import Robot
from exodrake.physics import finger, wire_paths
from exodrake.physics.tendon_finger import PART, Parameters
from exodrake.physics.wire_paths import EXTENSOR, FLEXOR

STEPS, STEP, HALVINGS = 40, 0.05, 46  # search: at most 2 rad in steps of 0.05 rad, then halved down to 1e-15 rad
MF_JOINTS = 1  # the MCP flexor passes the first joint only

# Where two routers meet, arms are not finite: no equilibrium there, rather than a division by zero.
# Not cached on disk, since numba would not notice a change of the other modules.
compiled = njit(error_model="numpy")
path, end_stop = compiled(wire_paths.path), compiled(finger.end_stop)


def read_parameters(robot: Robot) -> Parameters:
    """Parameters of a robot's finger, without effects."""
    found = [robot.channels(f"{field.group}.{field.name}") for field in PART.fields]
    plain: list[Any] = [tuple(v.tolist()) if len(v) > 1 else float(v[0]) for v in found]
    return Parameters(*plain)


@compiled
def joint_paths(i, angle, n):
    """Paths of a flexor and of the extensor over joint i: wire taken in [m], moment arm [m], its slope [m/rad]."""
    c, s = cos(angle), sin(angle)
    flexor = path(c, s, n.a_f[i], n.b_f[i], n.m_f[i], n.n_f[i], FLEXOR)
    return flexor, path(c, s, n.a_e[i], n.b_e[i], n.m_e[i], n.n_e[i], EXTENSOR)


@compiled
def excess(i, angle, tension, n):
    """Torque of the wires less the passive torque at joint i [N m]."""
    flexor, extensor = joint_paths(i, angle, n)
    mf = flexor[1] if i < MF_JOINTS else 0.0
    pulled = tension[0] * flexor[1] + tension[1] * mf + tension[2] * extensor[1]
    return pulled - n.kappa[i] * (angle - n.q0[i]) - end_stop(angle, n.q_f[i], n.q_e[i], n.beta[i], n.A[i])


@compiled
def settle(i, here, tension, n):
    """Angle of joint i at rest [rad]: along the torque from `here` until it turns, then halved to the last bits."""
    way = np.sign(excess(i, here, tension, n))
    for _ in range(STEPS):
        there = here + way * STEP
        if way * excess(i, there, tension, n) <= 0.0:
            for _ in range(HALVINGS):
                middle = 0.5 * (here + there)
                if way * excess(i, middle, tension, n) > 0.0:
                    here = middle
                else:
                    there = middle
            return 0.5 * (here + there)
        here = there
    return np.nan


@compiled
def settle_rows(tension, n, keep):
    """Angles at rest (rows, 3) [rad]; keep: whether a row starts where the row before ended."""
    angle = np.empty_like(tension)
    for i in range(3):
        here = n.q0[i]
        for row in range(len(tension)):
            angle[row, i] = settle(i, here, tension[row], n)
            here = angle[row, i] if keep and np.isfinite(angle[row, i]) else n.q0[i]
    return angle


def posture(tension: np.ndarray, n: Parameters) -> np.ndarray:
    """Joint angles at rest, (rows, 3) rad, under wire tensions (rows, 3) N: where a slow finger from q0 ends up.

    That is the first equilibrium along the torque. Arms grow with the angle, so a joint may have two beyond
    sum_j T_j dR_ji/dq > kappa_i, and which of them it takes then depends on its past. NaN for none within 2 rad.
    """
    return settle_rows(np.ascontiguousarray(tension, dtype=float), n, False)


def follow(tension: np.ndarray, n: Parameters) -> np.ndarray:
    """As `posture`, but each row starts where the row before ended: a joint with two equilibria keeps its own."""
    return settle_rows(np.ascontiguousarray(tension, dtype=float), n, True)


@compiled
def arms(angle, n):
    """P = dl/dq at joint angles (rows, 3) rad: (rows, 3 wires, 3 joints) m, extensors negative."""
    found = np.zeros((len(angle), 3, 3))
    for row in range(len(angle)):
        for i in range(3):
            flexor, extensor = joint_paths(i, angle[row, i], n)
            found[row, 0, i], found[row, 1, i] = flexor[1], flexor[1] if i < MF_JOINTS else 0.0
            found[row, 2, i] = extensor[1]
    return found
