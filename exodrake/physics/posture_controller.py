"""Posture controller: planned tensions, corrected by the integral of the angle error (around the paper's Fig. 4).

    c' = k_i G (q_ref - q)        F_ref = clip(F_plan + c, F_min, F_max)        G = J^T (J J^T + (d s)^2 I)^-1

c is the correction [N], J = dq/dF the compliance of the finger under its tendons [rad/N], s its largest singular value,
and d the damping of its inverse. c is cut so that F_plan + c stays within the limits, which keeps it from winding up.
"""

import numpy as np

DAMPING = 0.1  # assumed: directions in which a tension moves the finger less than this share of the best are spared


def damped_inverse(compliance: np.ndarray, damping: float = DAMPING) -> np.ndarray:
    """G (tendons, joints) [N/rad] from J (joints, tendons) [rad/N]."""
    size = damping * np.linalg.norm(compliance, 2)
    inner = compliance @ compliance.T + size**2 * np.eye(len(compliance))
    return np.linalg.solve(inner, compliance).T


def corrected(
    correction: np.ndarray,
    planned: np.ndarray,
    error: np.ndarray,
    gain: np.ndarray,
    step: float,
    low: np.ndarray,
    high: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Tension references and the correction of the next period.

    Args:
        correction: (tendons,) of the last period [N].
        planned: (tendons,) tensions [N].
        error: (joints,) wanted less estimated angles [rad]; NaN where there is no estimate yet, which counts as none.
        gain: (tendons, joints) [N/rad].
        step: k_i times the period [-].
        low: (tendons,) lower limits [N].
        high: (tendons,) upper limits [N].

    Returns:
        Tension references (tendons,) [N], and the new correction (tendons,) [N].
    """
    wanted = planned + correction
    for i, missing in enumerate(error):
        if missing == missing:
            wanted = wanted + step * gain[:, i] * missing
    tension = np.minimum(np.maximum(wanted, low), high)
    return tension, tension - planned
