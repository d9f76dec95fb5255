"""Disk margins: how far gains and phases of all commands may err at once (Seiler, Packard, Gahinet 2020).

Each command j passes (1 + d_j / 2) / (1 - d_j / 2), d_j complex with |d_j| < alpha. The loop stays stable for all of
them if and only if alpha max mu((S - T) / 2) < 1 over all frequencies, mu for diagonal uncertainty. The bound
min sigma_max(Q M Q^-1) over diagonal Q > 0 is mu itself for up to three channels, and above it for more. alpha covers
gains from (2 - alpha) / (2 + alpha) to its inverse and phases to 2 atan(alpha / 2).
"""

from __future__ import annotations

import numpy as np

DECOUPLED, FAR = 1e-20, 1e6  # share of squared coupling that scales nothing; bound of scalings
TIGHT = 1e-6  # of the search for scalings


def disk_margin(sensitivity: np.ndarray) -> np.ndarray:
    """Balanced disk margin (f,) [-] at each frequency, for all channels at once.

    Its minimum is exact; elsewhere it may be a little pessimistic.

    Args:
        sensitivity: S (f, channels, channels) of the commands [-].
    """
    balanced = sensitivity - 0.5 * np.eye(sensitivity.shape[-1])  # (S - T) / 2 with T = I - S
    bound, scale = structured_bound(balanced)
    if sensitivity.shape[-1] > 1:
        done: set[int] = set()
        while (worst := int(bound.argmax())) not in done:
            bound[worst] = min(refined(balanced[worst], scale[worst]), bound[worst])
            done.add(worst)
    return 1.0 / np.maximum(bound, np.finfo(float).tiny)


def structured_bound(m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest singular value (f,) [-] of matrices (f, k, k) [-] under balancing scalings (f, k) [-], and these."""
    k = m.shape[-1]
    size, scale = np.abs(m) ** 2, np.ones(m.shape[:2])
    for _ in range(30 if k > 1 else 0):
        for i in range(k):
            weighted = size * scale[:, :, None] ** 2 / scale[:, None, :] ** 2
            row, column = weighted[:, i].sum(-1) - weighted[:, i, i], weighted[:, :, i].sum(-1) - weighted[:, i, i]
            least = DECOUPLED * size.max(axis=(1, 2))
            scale[:, i] = np.clip(scale[:, i] * ((column + least) / (row + least)) ** 0.25, 1.0 / FAR, FAR)
    return np.linalg.norm(scale[:, :, None] * m / scale[:, None, :], 2, axis=(-2, -1)), scale


def refined(m: np.ndarray, start: np.ndarray) -> float:
    """Least sigma_max(Q M Q^-1) over diagonal Q > 0 of a matrix (k, k) [-], searched from scalings (k,) [-]."""
    from scipy.optimize import minimize

    def size(logs: np.ndarray) -> float:
        scale = np.exp(np.append(0.0, logs))
        return float(np.linalg.norm(scale[:, None] * m / scale, 2))

    logs, found = np.log(start[1:] / start[0]), np.inf
    for _ in range(3):  # the largest singular value has kinks: start again where the simplex ended
        result = minimize(size, logs, method="Nelder-Mead", options={"xatol": TIGHT, "fatol": TIGHT})
        logs, before, found = result.x, found, min(found, float(result.fun))
        if found > before * (1.0 - 10.0 * TIGHT):
            break
    return found
