"""Quasi-static sweeps of a worn nominal robot: the known truth of the estimator's tests (synthetic, seeded).

Written apart from the package on purpose: statics P(q)' T_d = tau_p(q) and s = l(q) + T_c / k of the nominal model,
solved by Newton steps. Each sweep is worn a little differently (`Wearer`): passive stiffness, rest posture, wire zero,
a slow drift of the rest posture (Ornstein-Uhlenbeck) and wire friction that opens a loop between loading and
unloading.
"""

from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np

TENDONS, JOINTS = ("AF", "MF", "AE"), ("MCP", "PIP", "DIP")
AXIAL, HEIGHT = 5e-3, np.array([3e-3, 3e-3, 5e-3])
KAPPA, REST = np.array([0.080, 0.060, 0.035]), np.array([0.20, 0.30, 0.15])
FLEX_STOP, EXTEND_STOP = np.array([1.30, 1.50, 0.95]), np.array([-0.30, 0.0, 0.0])
BETA, STOP = 12.0, 0.002
WIRE_STIFFNESS, LOW, HIGH = 2700.0, 0.3, np.array([12.0, 8.0, 8.0])
SIGN = np.array([1.0, 1.0, -1.0])
ACTS = np.array([[1, 1, 1], [1, 0, 0], [1, 1, 1]])  # wire x joint


@dataclass(frozen=True)
class Wearer:
    """How much one sweep differs from the next: standard deviations, and the friction all sweeps share."""

    stiffness: float = 0.02  # of kappa, relative
    rest: float = 0.008  # of q0 [rad]
    zero: float = 3e-5  # of each wire's zero [m]
    drift: float = 0.005  # of the slow drift of q0 [rad]
    drift_time: float = 3.0  # its correlation time [s]
    friction: float = 0.04  # tension lost (loading) or kept (unloading), relative


TYPICAL, NONE = Wearer(), np.zeros(3)


def wire_in(q):
    """Wire taken in, (..., 3 joints) rad -> (..., 3 wires) m."""
    rho, alpha = np.hypot(AXIAL, HEIGHT), np.arctan2(HEIGHT, AXIAL)
    half = q[..., None, :] * SIGN[:, None] / 2
    return np.sum(ACTS * 2 * rho[:, None] * (np.cos(alpha)[:, None] - np.cos(alpha[:, None] + half)), -1)


def arms(q):
    """Signed moment arms dl/dq, (..., 3 joints) rad -> (..., 3 wires, 3 joints) m."""
    rho, alpha = np.hypot(AXIAL, HEIGHT), np.arctan2(HEIGHT, AXIAL)
    half = q[..., None, :] * SIGN[:, None] / 2
    return ACTS * SIGN[:, None] * rho[:, None] * np.sin(alpha[:, None] + half)


def passive(q, kappa, rest):
    """Passive torque, (..., 3) rad -> (..., 3) N m."""
    axis, under = np.maximum(q - FLEX_STOP, 0), np.maximum(EXTEND_STOP - q, 0)
    return kappa * (q - rest) + STOP * (np.expm1(BETA * axis) - np.expm1(BETA * under))


def posture(tension, kappa=KAPPA, rest=REST, start=None, steps=300):
    """Static posture under wire tensions, (n, 3) N -> (n, 3) rad: downhill from `start` (default: rest).

    Newton steps where the posture is stable, at most 0.1 rad; elsewhere along the torque.
    """
    q = np.broadcast_to(rest if start is None else start, tension.shape).copy()
    for _ in range(steps):
        value, ahead = excess(q, tension, kappa, rest), excess(q + 1e-6, tension, kappa, rest)
        q += np.clip(value / np.maximum(-(ahead - value) / 1e-6, 0.01), -0.1, 0.1)
    return q


def excess(q, tension, kappa, rest):
    """Torque of the wires less the passive torque, (n, 3) N m; each joint's depends on its own angle only."""
    return np.einsum("nwj,nw->nj", arms(q), tension) - passive(q, kappa, rest)


def reference(wire, levels, rows, up_only=False):
    """One sweep's tension reference (rows, 3) N: `wire` goes up and down, the two others stay at `levels` (0..1)."""
    ramp = np.linspace(0, 1, rows) if up_only else 1 - np.abs(np.linspace(-1, 1, rows))
    share = np.insert(np.outer(np.ones(rows), levels), wire, ramp, axis=1)
    return LOW + (HIGH - LOW) * share


def protocol(count, rng, grid=(0, 1 / 3, 2 / 3, 1)):
    """`count` of the 48 (wire, levels) combinations of the paper's protocol, wires in turn, levels shuffled."""
    levels = [list(rng.permutation(list(product(grid, grid)))) for _ in range(3)]
    return [(i % 3, levels[i % 3][(i // 3) % len(levels[0])]) for i in range(count)]


def drifts(count, rows, wearer, rng):
    """Ornstein-Uhlenbeck drift of the rest posture, (rows, count, 3) rad."""
    decay = np.exp(-0.02 / wearer.drift_time)
    drift = wearer.drift * rng.normal(size=(rows, count, 3))
    for row in range(1, rows):
        drift[row] = decay * drift[row - 1] + np.sqrt(1 - decay**2) * drift[row]
    return drift


def worn_sweeps(count, seed, wearer=TYPICAL, rows=250, zero=NONE, rest=NONE, up_only=False):
    """`count` worn sweeps at 50 Hz, joined: dict of `time`, `tension_ref`, `tension`, `stroke`, `angle`, `sweep`.

    `zero` [m] and `rest` [rad] re-don the robot: they shift every sweep's wire zeros and rest posture.
    """
    rng = np.random.default_rng(seed)
    ref = np.stack([reference(wire, levels, rows, up_only) for wire, levels in protocol(count, rng)], axis=1)
    kappa = KAPPA * np.exp(wearer.stiffness * rng.normal(size=(count, 3)))
    worn_rest = REST + rest + wearer.rest * rng.normal(size=(count, 3)) + drifts(count, rows, wearer, rng)
    pull = ref * (1 - wearer.friction * np.tanh(np.gradient(ref, axis=0) / 1e-3))
    angle = np.empty_like(ref)
    angle[0] = posture(pull[0], kappa, worn_rest[0])
    for row in range(1, rows):
        angle[row] = posture(pull[row], kappa, worn_rest[row], angle[row - 1], steps=20)
    stroke = wire_in(angle) + ref / WIRE_STIFFNESS + zero + wearer.zero * rng.normal(size=(count, 3))
    columns = {
        "tension_ref": ref,
        "tension": ref + rng.normal(0, 0.01, ref.shape),
        "stroke": stroke + rng.normal(0, 1.2e-5, ref.shape),
        "angle": angle + rng.normal(0, 0.002, ref.shape),
    }
    joined = {name: values.swapaxes(0, 1).reshape(-1, 3) for name, values in columns.items()}
    return joined | {"time": 0.02 * np.arange(count * rows), "sweep": np.repeat(np.arange(count), rows)}


def as_sweeps(data):
    """The package's `Sweeps` of `worn_sweeps` data."""
    from exodrake.estimator.dataset import Sweeps

    inputs = np.hstack([data["tension"], data["stroke"]])
    return Sweeps(inputs, data["angle"], data["sweep"], data["time"], TENDONS, JOINTS, ("worn",))


def as_log(data, source="worn.csv"):
    """The package's `Log` of `worn_sweeps` data."""
    from exodrake.data.log import Log

    log = Log(data["time"], {}, source=source)
    for kind in ("tension_ref", "tension", "stroke"):
        log = log.with_array(kind, TENDONS, data[kind])
    return log.with_array("angle", JOINTS, data["angle"])


@cache
def trained():
    """(prior, estimator, training sweeps): 48 sweeps, 500 points, the prior from half of them. Trained once."""
    from exodrake.estimator.gp import QUICK_POINTS, condition, learn, learn_strokes

    sweeps = as_sweeps(worn_sweeps(48, seed=3))
    prior = learn(sweeps, QUICK_POINTS)
    return prior, replace(condition(prior, sweeps), strokes=learn_strokes(sweeps)), sweeps
