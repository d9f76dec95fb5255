"""Inverse statics: postures to tensions, which are one-sided and bounded, with joints that may snap.

Given a posture the statics are linear in the tensions, P(q)^T T = tau_p(q): the paper's Eq. 22 corrected, with rest
posture and end stops. Whether the finger then stands there is another question: T must lie in F_min .. F_max, the
equilibrium must be stable (arms grow with the angle, so tension softens joints, and under strong co-contraction the DIP
has two stable postures), and the ramp must lead to it.

Where no tensions hold a posture, `project` finds those whose posture is nearest: least squares within the bounds,
through the nonlinear statics along the ramp.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from exodrake.physics.finger import end_stop
from exodrake.physics.finger_statics import arms, follow, posture
from exodrake.physics.tendon_finger import Parameters
from exodrake.simulation.protocols import smooth

RAMP = 40  # postures along the approach
Confirm = Callable[[np.ndarray, np.ndarray], bool]
"""Whether these tensions (3,) [N] do lead to this posture (3,) [rad]: `trial.confirmed`."""

SAME = 2e-3  # rad, postures closer than this are one
STIFF = 0.4  # share of its passive stiffness that a joint keeps under tension, or it is too close to snapping
LEAD = 0.15  # share of the ramp by which extensors may run ahead of flexors or behind: tendons do not arrive together
EFFORT = 0.02  # rad2, what full tension of a tendon counts against a posture: no more co-contraction than it takes
NUDGE = 1e-5  # rad, of difference quotients
SINGULAR = 1e-12  # m3, |det P| below which tensions do not exist (`physics.md` 1.21: q2 = q3 with equal routers)
APART = 0.01  # rad between postures tried one after the other
STEPS, STARTS = 13, 4  # tensions per tendon tried, and starts of the least squares


def passive(angles: np.ndarray, n: Parameters) -> np.ndarray:
    """Passive torque (k, 3) [N m] at angles (k, 3) [rad]."""
    ends = [np.array(values) for values in (n.q_f, n.q_e, n.beta, n.A)]
    stop = np.vectorize(end_stop, otypes=[float])(angles, *ends)
    return np.array(n.kappa) * (angles - np.array(n.q0)) + stop


def tensions_for(angles: np.ndarray, n: Parameters) -> np.ndarray:
    """Tensions (k, 3) [N] in balance at postures (k, 3) [rad], of any sign and size; NaN where there are none."""
    transposed = np.swapaxes(arms(angles, n), 1, 2)
    exists = np.abs(np.linalg.det(transposed)) > SINGULAR
    found = np.full_like(angles, np.nan)
    found[exists] = np.linalg.solve(transposed[exists], passive(angles[exists], n)[..., None])[..., 0]
    return found


def stiffness(angles: np.ndarray, tension: np.ndarray, n: Parameters) -> np.ndarray:
    """Stiffness of each joint under tension (k, 3) [N m/rad]: below 0 it snaps."""
    up, down = angles + NUDGE, angles - NUDGE
    pull = np.einsum("kji,kj->ki", arms(up, n) - arms(down, n), tension)
    return (passive(up, n) - passive(down, n) - pull) / (2.0 * NUDGE)


def ramped(tension: np.ndarray, low: np.ndarray, n: Parameters, lead: float = 0.0) -> np.ndarray:
    """Posture (3,) [rad] at the end of a minimum-jerk ramp from rest to tension (3,) [N].

    low: (3,) F_min [N]. lead: fraction of the ramp by which the extensor runs ahead of the flexors.
    """
    ahead = np.array([-0.5, -0.5, 0.5]) * lead
    share = smooth(np.linspace(0.0, 1.0 + abs(lead), RAMP)[:, None] + ahead - 0.5 * abs(lead))
    return follow(low + share * (tension - low), n)[-1]


def steady(angles: np.ndarray, tension: np.ndarray, n: Parameters) -> np.ndarray:
    """Whether postures (k, 3) [rad] stand safely under tensions (k, 3) [N], and are where a slow finger ends up."""
    firm = (stiffness(angles, tension, n) >= STIFF * np.array(n.kappa)).all(axis=1)
    firm[firm] = (np.abs(posture(tension[firm], n) - angles[firm]) < SAME).all(axis=1)
    return firm


def arrives(angles: np.ndarray, tension: np.ndarray, low: np.ndarray, n: Parameters) -> bool:
    """Whether the ramp leads to this posture (3,) [rad], also when flexors or extensor run ahead."""
    return all(np.abs(ramped(tension, low, n, lead) - angles).max() < SAME for lead in (0.0, LEAD, -LEAD))


def holdable(
    angles: np.ndarray, cost: np.ndarray, low: np.ndarray, high: np.ndarray, n: Parameters, confirm: Confirm
) -> tuple[int, np.ndarray] | None:
    """The cheapest posture that the tendons hold and the ramp reaches; neighbours of one that fails are not tried.

    Args:
        angles: (k, 3) postures [rad].
        cost: (k,) of the postures.
        low: (3,) lower tension limits [N].
        high: (3,) upper tension limits [N].
        n: parameters of the finger.
        confirm: whether tensions do lead to a posture.

    Returns:
        Index of the posture and its tensions (3,) [N]; None if there is none.
    """
    tension = tensions_for(angles, n)
    inside = np.flatnonzero(((tension >= low) & (tension <= high)).all(axis=1))
    inside = inside[steady(angles[inside], tension[inside], n)]
    total = cost[inside] + EFFORT * ((tension[inside] - low) / (high - low)).sum(axis=1)
    left = inside[np.argsort(total, kind="stable")]
    while len(left):
        first = left[0]
        if arrives(angles[first], tension[first], low, n) and confirm(tension[first], angles[first]):
            return int(first), tension[first]
        left = left[np.abs(angles[left] - angles[first]).max(axis=1) > APART]
    return None


def reachable(low: np.ndarray, high: np.ndarray, n: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Tensions (k, 3) [N] over the box and their steady postures (k, 3) [rad]."""
    axes = [np.linspace(a, b, STEPS) for a, b in zip(low, high)]
    tension = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    angles = posture(tension, n)
    kept = np.isfinite(angles).all(axis=1)
    tension, angles = tension[kept], angles[kept]
    kept = steady(angles, tension, n)
    return tension[kept], angles[kept]


def project(
    wanted: np.ndarray,
    cloud: tuple[np.ndarray, np.ndarray],
    low: np.ndarray,
    high: np.ndarray,
    n: Parameters,
    confirm: Confirm,
) -> tuple[np.ndarray, np.ndarray]:
    """Tensions (3,) [N] within low .. high whose posture (3,) [rad], from rest along the ramp, is nearest `wanted`.

    cloud: `reachable`, whose nearest members are the starts; a solution too close to snapping is not taken.
    """
    from scipy.optimize import least_squares

    tension, angles = cloud

    def miss(x: np.ndarray) -> np.ndarray:
        return np.nan_to_num(ramped(x, low, n) - wanted, nan=1.0)

    best = np.inf, low, ramped(low, low, n)
    order = np.argsort(np.linalg.norm(angles - wanted, axis=1))
    for place in order[:STARTS]:
        start = np.clip(tension[place], low + 1e-3, high - 1e-3)
        found = least_squares(miss, start, bounds=(low, high), x_scale=high - low, diff_step=1e-4).x
        for x in (found, tension[place]):
            here = ramped(x, low, n)
            error = float(np.linalg.norm(here - wanted))
            safe = error < best[0] and steady(here[None], x[None], n)[0] and arrives(here, x, low, n)
            if safe and confirm(x, here):
                best = error, x, here
    return best[1], best[2]
