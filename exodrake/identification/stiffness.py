"""Stiffness identification with a model: the paper's Eq. 19-22, corrected, and joint stiffness fitted to logs.

At rest tau_i = sum_j R_ij T_j = kappa_i (q_i - q0_i) (Eq. 19-20), so with arms R > 0 in metres, rows MCP, PIP, DIP,
columns AF, MF, AE,

    q - q0 = J T      J = [[R11/k1, R12/k1, -R13/k1],
                         [R21/k2,   0,    -R23/k2],       (Eq. 21; R21 and R31 printed with k1)
                         [R31/k3,   0,    -R33/k3]]
    T = J^-1 (q - q0)    D = R21 R33 - R23 R31     entry (2,1) of J^-1 is k1 / R12 (Eq. 22; printed k1)

(`physics.md` 1.21; "as printed" means in our copy of the paper.) J depends on q, so angles come from
`statics.follow`,
along a log, or `statics.posture`, each row from rest. `linear` takes the end stops out of the numbers: the paper's
model with constant stiffness.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError
from exodrake.systems.finger_statics import arms, follow
from exodrake.systems.tendon_finger import Parameters

ROWS = 400  # rows of a log a fit looks at, equispaced: neighbours 20 ms apart say the same
MIN_SPAN = 0.05  # rad, a joint that moved less says nothing about its stiffness

Statics = Callable[[np.ndarray, Parameters], np.ndarray]


@dataclass(frozen=True)
class Stiffness:
    """Fitted joint stiffness and rest posture with standard errors (joints MCP, PIP, DIP), and RMSE [rad] on the rows
    of the fit.

    Standard errors take residuals of neighbouring rows for independent, which wearers are not: lower bounds.
    """

    kappa: tuple[float, ...]
    q0: tuple[float, ...]
    kappa_error: tuple[float, ...]
    q0_error: tuple[float, ...]
    rmse: tuple[float, ...]

    def parameters(self, n: Parameters) -> Parameters:
        """The numbers with the fitted stiffness and rest posture in."""
        return n._replace(kappa=self.kappa, q0=self.q0)


def linear(n: Parameters) -> Parameters:
    """The numbers without end stops: constant stiffness, as the paper's model-based estimate has it."""
    return n._replace(A=(0.0, 0.0, 0.0))


def router_arms(angle: np.ndarray, n: Parameters) -> np.ndarray:
    """R of Eq. 21 at one posture (3,) rad: (3 joints, 3 wires) m, extensor arms positive while they extend."""
    return arms(angle[None], n)[0].T * np.array([1.0, 1.0, -1.0])


def determinant(r: np.ndarray) -> float:
    """D = R21 R33 - R23 R31 [m2]. D > 0: the PIP alone can flex; D < 0: the DIP alone; D = 0 (same routers, q2 = q3):
    J is singular."""
    return float(r[1, 0] * r[2, 2] - r[1, 2] * r[2, 0])


def compliance(r: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """J of the corrected Eq. 21 [rad/N]: row i divided by kappa_i [N m/rad]."""
    return np.array([1.0, 1.0, -1.0]) * _mf_first(r) / np.asarray(kappa)[:, None]


def compliance_as_printed(r: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """J of Eq. 21 as printed: column AF is divided by kappa_1 in every row."""
    divisor = np.tile(np.asarray(kappa, dtype=float)[:, None], 3)
    divisor[:, 0] = kappa[0]
    return np.array([1.0, 1.0, -1.0]) * _mf_first(r) / divisor


def tension_map(r: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """J^-1 of the corrected Eq. 22 [N/rad]. InputError where it does not exist (D = 0 or R12 = 0)."""
    return _printed_map(r, kappa, kappa[0] / r[0, 1] if r[0, 1] else np.inf)


def tension_map_as_printed(r: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """J^-1 of Eq. 22 as printed: entry (2, 1) is kappa_1, in another unit than its neighbours."""
    return _printed_map(r, kappa, kappa[0])


def fit_stiffness(tension: np.ndarray, angle: np.ndarray, n: Parameters, statics: Statics = follow) -> Stiffness:
    """Least squares in angle for kappa and q0 of each joint; the rest of `n` (routers, end stops) is taken as known.

    tension (rows, 3) N, angle (rows, 3) rad, slow enough to be quasi-static. statics: `follow` for rows of a log in
    order, `posture` for rows that each start from rest. Starts from the line through torque against angle. Rows with
    missing samples are left out. InputError if fewer than ten rows remain, or a joint hardly moved.
    """
    whole = np.isfinite(tension).all(axis=1) & np.isfinite(angle).all(axis=1)
    kept = np.flatnonzero(whole)
    if len(kept) < 10:
        raise InputError(f"stiffness: {len(kept)} rows with tension and angle, at least 10 are needed")
    kept = kept[np.linspace(0, len(kept) - 1, min(ROWS, len(kept))).round().astype(int)]
    tension, angle = tension[kept], angle[kept]
    fits = [_fit_joint(joint, tension, angle[:, joint], n, statics) for joint in range(3)]
    kappa, q0, kappa_error, q0_error, rmse = (tuple(float(fit[i]) for fit in fits) for i in range(5))
    return Stiffness(kappa, q0, kappa_error, q0_error, rmse)


def _fit_joint(
    joint: int, tension: np.ndarray, angle: np.ndarray, n: Parameters, statics: Statics
) -> tuple[float, ...]:
    """kappa, q0, their standard errors and the RMSE of one joint. Fitted in (log kappa, q0): stiffness stays
    positive."""
    from scipy.optimize import least_squares

    if np.ptp(angle) < MIN_SPAN:
        raise InputError(
            f"stiffness: joint {joint + 1} moved {np.ptp(angle):.3f} rad, at least {MIN_SPAN} rad are needed"
        )

    def residual(x: np.ndarray) -> np.ndarray:
        kappa, q0 = list(n.kappa), list(n.q0)
        kappa[joint], q0[joint] = float(np.exp(x[0])), float(x[1])
        found = statics(tension, n._replace(kappa=tuple(kappa), q0=tuple(q0)))[:, joint]
        return np.where(np.isfinite(found), found - angle, 1.0)

    start = _start(joint, tension, angle, n)
    # beyond the fold the posture jumps to the end stop; a bounded loss keeps such rows from ruling
    best = least_squares(residual, start, loss="soft_l1", f_scale=0.1)
    error = residual(best.x)
    variance = float(error @ error) / max(len(error) - 2, 1)
    spread = np.sqrt(np.diag(np.linalg.pinv(best.jac.T @ best.jac)) * variance)
    kappa = float(np.exp(best.x[0]))
    return kappa, float(best.x[1]), kappa * spread[0], spread[1], float(np.sqrt(np.mean(error**2)))


def _start(joint: int, tension: np.ndarray, angle: np.ndarray, n: Parameters) -> np.ndarray:
    """(log kappa, q0) of the line through torque against angle between the end stops; those of `n` if it falls."""
    inside = (angle > n.q_e[joint]) & (angle < n.q_f[joint])
    if inside.sum() >= 10:
        at = np.zeros((int(inside.sum()), 3))
        at[:, joint] = angle[inside]
        torque = np.sum(arms(at, n)[:, :, joint] * tension[inside], axis=1)
        slope, level = np.polyfit(angle[inside], torque, 1)
        if slope > 0:
            return np.array([np.log(slope), -level / slope])
    return np.array([np.log(n.kappa[joint]), n.q0[joint]])


def _mf_first(r: np.ndarray) -> np.ndarray:
    """R with the MCP flexor at the first joint only."""
    masked = np.array(r, dtype=float)
    masked[1:, 1] = 0.0
    return masked


def _printed_map(r: np.ndarray, kappa: np.ndarray, first: float) -> np.ndarray:
    """Eq. 22 with entry (2, 1) given."""
    d, k = determinant(r), kappa
    if d == 0 or r[0, 1] == 0:
        raise InputError(f"no tensions for this posture: D = {d:g} m2, R12 = {r[0, 1]:g} m")
    second = k[1] * (r[0, 2] * r[2, 0] - r[0, 0] * r[2, 2]) / r[0, 1]
    third = k[2] * (r[0, 0] * r[1, 2] - r[0, 2] * r[1, 0]) / r[0, 1]
    rows = [[0.0, k[1] * r[2, 2], -k[2] * r[1, 2]], [first * d, second, third], [0.0, k[1] * r[2, 0], -k[2] * r[1, 0]]]
    return np.array(rows) / d
