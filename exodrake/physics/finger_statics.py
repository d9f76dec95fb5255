"""Posture of the nominal finger at rest under given wire tensions: P(q)^T T = tau_p(q), solved per joint.

A wire's moment arm at a joint depends on that joint's angle alone, so the three equations are independent:

    sum_j T_j R_ji(q_i) = kappa_i (q_i - q0_i) + end_stop(q_i)

Parameters are those of `physics.tendon_finger` (same functions, compiled here): wires AF, MF, AE; joints MCP, PIP, DIP.
"""

from math import cos, sin
from typing import Any

import numpy as np
from numba import njit

from exodrake.core.part import fields_of
from exodrake.core.robot import Robot
from exodrake.physics import finger, routers
from exodrake.physics.routers import EXTENSOR, FLEXOR
from exodrake.physics.tendon_finger import Parameters

STEPS, STEP, HALVINGS = 40, 0.05, 46  # search: at most 2 rad in steps of 0.05 rad, then halved down to 1e-15 rad
MF_JOINTS = 1  # the MCP flexor passes the first joint only

# Where two routers meet, arms are not finite: no equilibrium there, rather than a division by zero.
# Not cached on disk, since numba would not notice a change of the other modules.
compiled = njit(error_model="numpy")
path, end_stop = compiled(routers.path), compiled(finger.end_stop)


def parameters_of(robot: Robot) -> Parameters:
    """Parameters of a robot's finger, without effects."""
    found = [robot.channels(f"{field.group}.{field.name}") for field in fields_of(Parameters, "finger")]
    plain: list[Any] = [tuple(v.tolist()) if len(v) > 1 else float(v[0]) for v in found]
    return Parameters(*plain)


def posture(tension: np.ndarray, n: Parameters) -> np.ndarray:
    """Joint angles at rest, (rows, 3) rad, under wire tensions (rows, 3) N: where a slow finger from q0 ends up.

    That is the first equilibrium along the torque. Arms grow with the angle, so a joint may have two beyond
    sum_j T_j dR_ji/dq > kappa_i, and which of them it takes then depends on its past. NaN for none within 2 rad.
    """
    return _postures(np.ascontiguousarray(tension, dtype=float), n)


def follow(tension: np.ndarray, n: Parameters) -> np.ndarray:
    """As `posture`, but each row starts where the row before ended: a joint with two equilibria keeps its own."""
    return _followed(np.ascontiguousarray(tension, dtype=float), n)


def arms(angle: np.ndarray, n: Parameters) -> np.ndarray:
    """P = dl/dq at joint angles (rows, 3) rad: (rows, 3 wires, 3 joints) m, extensors negative."""
    return _arms(np.ascontiguousarray(angle, dtype=float), n)


@compiled
def joint_paths(i, angle, n):
    """Moment arms R of AF, MF, AE at joint i [m]."""
    c, s = cos(angle), sin(angle)
    _, flexor, _ = path(c, s, n.a_f[i], n.b_f[i], n.m_f[i], n.n_f[i], FLEXOR)
    _, extensor, _ = path(c, s, n.a_e[i], n.b_e[i], n.m_e[i], n.n_e[i], EXTENSOR)
    if i < MF_JOINTS:
        return flexor, flexor, extensor
    return flexor, 0.0, extensor


@compiled
def excess(i, angle, tension, n):
    """Torque of the wires less the passive torque at joint i [N m]."""
    af, mf, ae = joint_paths(i, angle, n)
    pulled = tension[0] * af + tension[1] * mf + tension[2] * ae
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
def _postures(tension, n):
    angle = np.empty_like(tension)
    for row in range(len(tension)):
        for i in range(3):
            angle[row, i] = settle(i, n.q0[i], tension[row], n)
    return angle


@compiled
def _followed(tension, n):
    angle = np.empty_like(tension)
    for i in range(3):
        here = n.q0[i]
        for row in range(len(tension)):
            angle[row, i] = settle(i, here, tension[row], n)
            here = angle[row, i] if np.isfinite(angle[row, i]) else n.q0[i]
    return angle


@compiled
def _arms(angle, n):
    found = np.empty((len(angle), 3, 3))
    for row in range(len(angle)):
        for i in range(3):
            found[row, :, i] = joint_paths(i, angle[row, i], n)
    return found
