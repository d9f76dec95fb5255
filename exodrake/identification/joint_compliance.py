"""Joint compliance and its inverse at constant stiffness: the paper's Eq. 21 and 22, corrected.

With arms R > 0 in metres, rows MCP, PIP, DIP, columns AF, MF, AE, and stiffness k,

    q - q0 = J T      J = [[R11/k1, R12/k1, -R13/k1],
                         [R21/k2,   0,    -R23/k2],       (Eq. 21; R21 and R31 printed with k1)
                         [R31/k3,   0,    -R33/k3]]
    T = J^-1 (q - q0)    D = R21 R33 - R23 R31     entry (2,1) of J^-1 is k1 / R12 (Eq. 22; printed k1)

(`physics.md` 1.21.) J depends on q, so that it gives tendencies. `grasping.inverse_statics` solves the nonlinear torque
balance with rest posture and end stops; `identification.stiffness` fits kappa and q0 through it.
"""

import numpy as np

from exodrake.core.errors import InputError
from exodrake.physics.finger_statics import arms
from exodrake.physics.tendon_finger import Parameters

ROUTER_SIGNS = np.array([1.0, 1.0, -1.0])  # of AF, MF, AE


def router_arms(angle: np.ndarray, n: Parameters) -> np.ndarray:
    """R of Eq. 21, (3 joints, 3 wires) [m], at one posture (3,) [rad]; extensor arms are positive while they extend."""
    return arms(angle[None], n)[0].T * ROUTER_SIGNS


def determinant(r: np.ndarray) -> float:
    """D = R21 R33 - R23 R31 [m2] of arms r (3, 3) [m]; J is singular for D = 0 (same routers, q2 = q3).

    The PIP alone can flex for D > 0, the DIP alone for D < 0.
    """
    return float(r[1, 0] * r[2, 2] - r[1, 2] * r[2, 0])


def compliance(r: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """J (3, 3) [rad/N] of the corrected Eq. 21: row i of arms r (3, 3) [m] over kappa_i (3,) [N m/rad]."""
    passed = np.array([[1.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 1.0]])  # MF passes the first joint only
    return ROUTER_SIGNS * passed * r / np.asarray(kappa)[:, None]


def tension_map(r: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """J^-1 (3, 3) [N/rad] of the corrected Eq. 22. InputError where it does not exist (D = 0 or R12 = 0)."""
    return tension_map_with(r, kappa, kappa[0] / r[0, 1] if r[0, 1] else np.inf)


def tension_map_with(r: np.ndarray, kappa: np.ndarray, first: float) -> np.ndarray:
    """J^-1 (3, 3) [N/rad] of Eq. 22 with entry (2, 1) over D given; arms r (3, 3) [m], kappa (3,) [N m/rad]."""
    d, k = determinant(r), kappa
    if d == 0 or r[0, 1] == 0:
        raise InputError(f"no tensions for this posture: D = {d:g} m2, R12 = {r[0, 1]:g} m")
    second = k[1] * (r[0, 2] * r[2, 0] - r[0, 0] * r[2, 2]) / r[0, 1]
    third = k[2] * (r[0, 0] * r[1, 2] - r[0, 2] * r[1, 0]) / r[0, 1]
    rows = [[0.0, k[1] * r[2, 2], -k[2] * r[1, 2]], [first * d, second, third], [0.0, k[1] * r[2, 0], -k[2] * r[1, 0]]]
    return np.array(rows) / d
