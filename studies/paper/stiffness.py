"""Joint stiffness and rest posture from logs (Eq. 19-20 of the paper), and Eq. 21 and 22, corrected.

At rest tau_i = sum_j R_ij T_j = kappa_i (q_i - q0_i) + end stop, with arms R of the wires AF, MF, AE at the joints MCP,
PIP, DIP: `docs/explain/identification.md`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError
from exodrake.physics.finger_statics import arms, follow
from exodrake.physics.tendon_finger import Parameters

ROWS = 400  # rows of a log in a fit, equispaced: neighbours 20 ms apart carry the same information
MIN_SPAN = 0.05  # rad, less motion does not determine a stiffness
ROUTER_SIGNS = np.array([1.0, 1.0, -1.0])  # of AF, MF, AE

Statics = Callable[[np.ndarray, Parameters], np.ndarray]


@dataclass(frozen=True)
class Stiffness:
    """Stiffness and rest posture of MCP, PIP, DIP.

    The standard error assumes independent residuals in neighbouring rows, so it is a lower bound for a wearer.
    """

    kappa: tuple[float, ...]  # [N m/rad]
    q0: tuple[float, ...]  # [rad]
    kappa_error: tuple[float, ...]
    rmse: tuple[float, ...]  # on the rows of the fit [rad]

    def parameters(self, n: Parameters) -> Parameters:
        """Replace stiffness and rest posture of the parameters by the fitted ones."""
        return n._replace(kappa=self.kappa, q0=self.q0)


def linear(n: Parameters) -> Parameters:
    """Remove the end stops from the parameters: constant stiffness, as in the paper's model-based estimate."""
    return n._replace(A=(0.0, 0.0, 0.0))


def fit_stiffness(tension: np.ndarray, angle: np.ndarray, n: Parameters, statics: Statics = follow) -> Stiffness:
    """Fit stiffness and rest posture of each joint by least squares in angle, from quasi-static rows.

    Tension (rows, 3) [N] is of AF, MF, AE, measured angle (rows, 3) [rad] of MCP, PIP, DIP; rows with missing samples
    are left out, routers and end stops taken as known. Statics are `follow` for rows of a log in order, `posture` for
    rows that each start from rest.

    Raises:
        InputError: If fewer than ten rows are complete, or a joint hardly moves.
    """
    from scipy.optimize import least_squares

    kept = np.flatnonzero(np.isfinite(tension).all(axis=1) & np.isfinite(angle).all(axis=1))
    if len(kept) < 10:
        raise InputError(f"stiffness: {len(kept)} rows with tension and angle, at least 10 are needed")
    kept = kept[np.linspace(0, len(kept) - 1, min(ROWS, len(kept))).round().astype(int)]
    tension, fits = tension[kept], []

    def residual(x: np.ndarray, joint: int) -> np.ndarray:
        kappa, q0 = list(n.kappa), list(n.q0)
        kappa[joint], q0[joint] = float(np.exp(x[0])), float(x[1])
        found = statics(tension, n._replace(kappa=tuple(kappa), q0=tuple(q0)))[:, joint]
        return np.where(np.isfinite(found), found - angle[kept, joint], 1.0)

    for joint, q in enumerate(angle[kept].T):
        if (span := np.ptp(q)) < MIN_SPAN:
            raise InputError(f"stiffness: joint {joint + 1} moved {span:.3f} rad, at least {MIN_SPAN} rad are needed")
        start = [np.log(n.kappa[joint]), n.q0[joint]]
        inside = (q > n.q_e[joint]) & (q < n.q_f[joint])
        if inside.sum() >= 10:  # the line through torque against angle between the end stops, if it rises
            at = np.zeros((int(inside.sum()), 3))
            at[:, joint] = q[inside]
            torque = np.sum(arms(at, n)[:, :, joint] * tension[inside], axis=1)
            slope, level = np.polyfit(q[inside], torque, 1)
            start = [np.log(slope), -level / slope] if slope > 0 else start
        # beyond the fold the posture jumps to the end stop; a robust loss limits the weight of such rows
        best = least_squares(residual, start, loss="soft_l1", f_scale=0.1, args=(joint,))
        error = residual(best.x, joint)
        variance = float(error @ error) / max(len(error) - 2, 1)
        spread = np.sqrt(np.diag(np.linalg.pinv(best.jac.T @ best.jac)) * variance)
        kappa = float(np.exp(best.x[0]))
        fits.append((kappa, best.x[1], kappa * spread[0], np.sqrt(np.mean(error**2))))
    return Stiffness(*(tuple(float(value) for value in column) for column in zip(*fits)))


def router_arms(angle: np.ndarray, n: Parameters) -> np.ndarray:
    """R of Eq. 21, (3 joints, 3 wires) [m], at one posture (3,) [rad]; extensor arms are positive while they extend."""
    return arms(angle[None], n)[0].T * ROUTER_SIGNS


def compliance(r: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """J (3, 3) [rad/N] of the corrected Eq. 21: row i of arms r (3, 3) [m] over kappa_i (3,) [N m/rad]."""
    passed = np.array([[1.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 1.0]])  # MF passes the first joint only
    return ROUTER_SIGNS * passed * r / np.asarray(kappa)[:, None]


def tension_map(r: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """J^-1 (3, 3) [N/rad] of the corrected Eq. 22. InputError where it does not exist (D = 0 or R12 = 0)."""
    d = r[1, 0] * r[2, 2] - r[1, 2] * r[2, 0]
    if d == 0 or r[0, 1] == 0:
        raise InputError(f"no tensions for this posture: D = {d:g} m2, R12 = {r[0, 1]:g} m")
    return np.linalg.inv(compliance(r, kappa))
