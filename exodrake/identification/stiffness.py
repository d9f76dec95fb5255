"""Joint stiffness and rest posture from logs (Eq. 19-20 of the paper).

At rest tau_i = sum_j R_ij T_j = kappa_i (q_i - q0_i) + end stop, with arms R of the wires AF, MF, AE at the joints MCP,
PIP, DIP. Angles follow from `finger_statics.follow` along a log, or from `finger_statics.posture` for rows that each
start from rest. `linear` removes the end stops from the parameters: the paper's model with constant stiffness.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError
from exodrake.physics.finger_statics import arms, follow
from exodrake.physics.tendon_finger import Parameters

ROWS = 400  # rows of a log in a fit, equispaced: neighbours 20 ms apart carry the same information
MIN_SPAN = 0.05  # rad, less motion does not determine a stiffness

Statics = Callable[[np.ndarray, Parameters], np.ndarray]


@dataclass(frozen=True)
class Stiffness:
    """Fitted joint stiffness and rest posture of MCP, PIP and DIP.

    Standard errors assume independent residuals in neighbouring rows, so they are lower bounds for a wearer.

    Attributes:
        kappa: (3,) stiffness [N m/rad].
        q0: (3,) rest posture [rad].
        kappa_error: (3,) standard error [N m/rad].
        q0_error: (3,) standard error [rad].
        rmse: (3,) root mean square error on the rows of the fit [rad].
    """

    kappa: tuple[float, ...]
    q0: tuple[float, ...]
    kappa_error: tuple[float, ...]
    q0_error: tuple[float, ...]
    rmse: tuple[float, ...]

    def parameters(self, n: Parameters) -> Parameters:
        """Replace stiffness and rest posture of the parameters by the fitted ones."""
        return n._replace(kappa=self.kappa, q0=self.q0)


def linear(n: Parameters) -> Parameters:
    """Remove the end stops from the parameters: constant stiffness, as in the paper's model-based estimate."""
    return n._replace(A=(0.0, 0.0, 0.0))


def fit_stiffness(tension: np.ndarray, angle: np.ndarray, n: Parameters, statics: Statics = follow) -> Stiffness:
    """Fit stiffness and rest posture of each joint by least squares in angle, from quasi-static rows.

    Args:
        tension: (rows, 3) tension of AF, MF, AE [N]; rows with missing samples are left out.
        angle: (rows, 3) measured angle of MCP, PIP, DIP [rad].
        n: Parameters of the finger; routers and end stops are taken as known.
        statics: `follow` for rows of a log in order, `posture` for rows that each start from rest.

    Returns:
        The fitted stiffness.

    Raises:
        InputError: If fewer than ten rows are complete, or a joint hardly moves.
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
    """Fit (log kappa, q0) of one joint: kappa, q0, their standard errors and the RMSE."""
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
    # beyond the fold the posture jumps to the end stop; a robust loss limits the weight of such rows
    best = least_squares(residual, start, loss="soft_l1", f_scale=0.1)
    error = residual(best.x)
    variance = float(error @ error) / max(len(error) - 2, 1)
    spread = np.sqrt(np.diag(np.linalg.pinv(best.jac.T @ best.jac)) * variance)
    kappa = float(np.exp(best.x[0]))
    return kappa, float(best.x[1]), kappa * spread[0], spread[1], float(np.sqrt(np.mean(error**2)))


def _start(joint: int, tension: np.ndarray, angle: np.ndarray, n: Parameters) -> np.ndarray:
    """Start at the line through torque against angle between the end stops; at `n` if that line falls."""
    inside = (angle > n.q_e[joint]) & (angle < n.q_f[joint])
    if inside.sum() >= 10:
        at = np.zeros((int(inside.sum()), 3))
        at[:, joint] = angle[inside]
        torque = np.sum(arms(at, n)[:, :, joint] * tension[inside], axis=1)
        slope, level = np.polyfit(angle[inside], torque, 1)
        if slope > 0:
            return np.array([np.log(slope), -level / slope])
    return np.array([np.log(n.kappa[joint]), n.q0[joint]])
