"""Refinement: maximum a posteriori fit of an explanation together with the nominal parameters.

The method is Levenberg-Marquardt within bounds (Marquardt 1963). After a step that fails the parameters of effects keep
within a box, a trust region: damping by the curvature does not hold one back that has none yet, such as a limit that is
not reached. The nominal Jacobian is expensive and changes little: it is given with the start and corrected after each
step (Broyden 1965). The few columns of the effects are simulated at each step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.parameter import STEP, Parameter, apply

DAMPING, LARGER, SMALLER = 1e-6, 30.0, 0.2  # at first, and its factors after a bad and a good step
SHORTER = 0.25  # of the longest step of an effect's parameter after a bad step; one scale at the first: assumed
TRIES = 4  # damped steps before a fit ends
STEPS, TOL = 5, 5e-4  # of a fit as a rule
FREE = 1e3  # prior standard deviations, in scales, of an effect's parameter: none, but the matrix stays regular


@dataclass(frozen=True, eq=False)
class Explanation:
    """A set of effects with its fitted robot.

    Attributes:
        effects: ids.
        parameters: fitted parameters, nominal ones first.
        x: (parameters,) coordinates.
        values: (n,) flat vector of the robot with the fixed parameters of its effects, at x = 0.
        residual: (samples,) whitened [noise_std].
        jacobian: (nominal, samples) derivatives by the nominal parameters nearby.
        rough: whether a fit ended here since the cost does not fall as derivatives promise.
    """

    effects: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    x: np.ndarray
    values: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray
    rough: bool = False

    @property
    def robot(self) -> np.ndarray:
        """Flat parameter vector (n,) of the fitted robot."""
        return apply(self.values, self.parameters, self.x)

    @property
    def at_nominal(self) -> np.ndarray:
        """Flat parameter vector (n,) with the fitted effects and the nominal parameters as they were."""
        return apply(self.values, self.parameters, np.concatenate([np.zeros(self.nominal), self.x[self.nominal :]]))

    @property
    def name(self) -> str:
        """Ids joined by +; `retune` without an effect."""
        return " + ".join(self.effects) or "retune"

    @property
    def nominal(self) -> int:
        """Number of nominal parameters."""
        return len(self.jacobian)

    @cached_property
    def prior_std(self) -> np.ndarray:
        """Prior standard deviations (parameters,)."""
        return np.array([min(p.prior_std, FREE * p.scale) for p in self.parameters])

    @property
    def use(self) -> np.ndarray:
        """Coordinates in standard deviations of their priors (parameters,)."""
        return self.x / self.prior_std

    @property
    def bounds(self) -> np.ndarray:
        """Lower and upper ends of the coordinates (2, parameters)."""
        return np.array([p.bounds for p in self.parameters]).reshape(-1, 2).T

    def cost(self, likelihood: Likelihood) -> float:
        """Half the sum of squares of the weighted residual and of the coordinates in units of their priors."""
        return likelihood.cost(self.residual, self.x, self.prior_std)

    def at(self, likelihood: Likelihood, x: np.ndarray) -> Explanation:
        """The explanation at other coordinates x (parameters,)."""
        return self.at_each(likelihood, [x])[0]

    def at_each(self, likelihood: Likelihood, points: Sequence[np.ndarray]) -> list[Explanation]:
        """The explanation at several coordinates x (parameters,), simulated at once."""
        residuals = likelihood.residual(np.array([apply(self.values, self.parameters, x) for x in points]))
        moved = zip(points, residuals, strict=True)
        return [replace(self, x=x, residual=residual, rough=False) for x, residual in moved]

    def with_jacobian(self, jacobian: np.ndarray) -> Explanation:
        """The explanation with another nominal Jacobian, beside which a fit has yet to end."""
        return self.changed(jacobian=jacobian, rough=False)

    def changed(self, **fields: Any) -> Explanation:
        """The explanation with other fields at the same coordinates: derivatives by its effects are kept."""
        found = replace(self, **fields)
        if self in COLUMNS:
            COLUMNS[found] = COLUMNS[self]
        return found


def minimise(likelihood: Likelihood, start: Explanation, steps: int, tol: float) -> Explanation:
    """The explanation after at most `steps` steps; it ends when a step lowers the cost by less than the share `tol`."""
    found, damping = start, DAMPING
    reach = np.array([p.scale if p.effect else np.inf for p in start.parameters])
    for _ in range(steps):
        columns, before = whole_jacobian(likelihood, found), found.cost(likelihood)
        slope, curvature = slope_and_curvature(likelihood, found, columns)
        promised = 0.0
        for failed in range(TRIES):
            longest = reach * SHORTER ** (failed - 1) if failed else np.inf
            trial, gain = stepped(likelihood, found, slope, curvature + damping * np.diag(np.diag(curvature)), longest)
            promised = max(promised, gain)
            known = np.concatenate([found.jacobian, columns[found.nominal :]])
            found = corrected(found, trial, found.residual + (trial.x - found.x) @ known)
            if trial.cost(likelihood) < before:
                break
            damping = max(LARGER * damping, 1e-3)
        else:
            return found.changed(rough=promised > tol * before)
        found, damping = trial.with_jacobian(found.jacobian), max(SMALLER * damping, DAMPING)
        if found.cost(likelihood) > (1.0 - tol) * before:
            COLUMNS[found] = columns[found.nominal :]
            break
    return found


COLUMNS: WeakKeyDictionary[Explanation, np.ndarray] = WeakKeyDictionary()  # of explanations that were differentiated


def whole_jacobian(likelihood: Likelihood, here: Explanation) -> np.ndarray:
    """Derivatives (parameters, samples) of the residual by all parameters; those by the effects are simulated once."""
    if here not in COLUMNS:
        COLUMNS[here] = effect_columns(likelihood, here)
    return np.concatenate([here.jacobian, COLUMNS[here]])


def effect_columns(likelihood: Likelihood, here: Explanation) -> np.ndarray:
    """Derivatives (effect parameters, samples) by the parameters of the effects, away from the nearer bound."""
    count = here.nominal
    if count == len(here.parameters):
        return np.zeros((0, len(here.residual)), dtype=np.float32)
    steps, rows = [], []
    for i, p in enumerate(here.parameters[count:], start=count):
        step = STEP * p.scale
        step = -step if here.x[i] + step > p.bounds[1] else step
        moved = here.x.copy()
        moved[i] += step
        steps.append(step)
        rows.append(apply(here.values, here.parameters, moved))
    return likelihood.derivatives(np.array(rows), here.residual, np.array(steps))


def slope_and_curvature(
    likelihood: Likelihood, here: Explanation, columns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Gradient (parameters,) and Gauss-Newton matrix (parameters, parameters) of the cost."""
    weighted, precision = np.multiply(columns, likelihood.weights, dtype=float), 1.0 / here.prior_std**2
    slope = weighted @ (here.residual * likelihood.weights) + precision * here.x
    return slope, weighted @ weighted.T + np.diag(precision)


def stepped(
    likelihood: Likelihood, here: Explanation, slope: np.ndarray, curvature: np.ndarray, longest: np.ndarray | float
) -> tuple[Explanation, float]:
    """The explanation after one step within its bounds, and by how much the derivatives let its cost fall.

    longest: (parameters,) change of each parameter.
    """
    low, high = here.bounds - here.x
    move, change = bounded(curvature, slope, np.maximum(low, -longest), np.minimum(high, longest))
    return here.at(likelihood, np.clip(here.x + move, low + here.x, high + here.x)), -change


def corrected(here: Explanation, trial: Explanation, expected: np.ndarray) -> Explanation:
    """The explanation with its nominal Jacobian corrected by what a step showed."""
    count = here.nominal
    move = (trial.x - here.x)[:count]
    weight = move / here.prior_std[:count] ** 2
    size = float(weight @ move)
    if size < 1e-6:
        return here
    change = np.outer(weight / size, trial.residual - expected).astype(np.float32)
    return here.with_jacobian(here.jacobian + change)


def bounded(normal: np.ndarray, slope: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, float]:
    """Minimiser (n,) of f's + f'Nf / 2 within bounds, and the minimum (active set; Stark & Parker 1995)."""
    from scipy.optimize import lsq_linear

    size = np.sqrt(np.maximum(np.diag(normal), 1e-12))
    scaled = normal / np.outer(size, size) + 1e-8 * np.eye(len(size))
    try:
        factor = np.linalg.cholesky(scaled).T
    except np.linalg.LinAlgError:  # columns that others imitate, less what these explain, in single precision
        own = np.maximum(np.diag(normal), 0.0)
        size = np.sqrt(np.maximum(own, max(1e-6 * own.max(), 1e-12)))
        scaled = (normal + np.diag(own - np.diag(normal))) / np.outer(size, size)
        values, vectors = np.linalg.eigh(scaled)
        factor = np.sqrt(np.maximum(values, 1e-6 * max(1.0, values[-1])))[:, None] * vectors.T
        scaled = factor.T @ factor
    target = np.linalg.solve(factor.T, -slope / size)
    found = np.linalg.solve(factor, target)
    ends = low * size, np.maximum(high * size, low * size + 1e-9)
    if np.any((found < ends[0]) | (found > ends[1])):
        found = lsq_linear(factor, target, ends, method="bvls").x
    return found / size, float(0.5 * found @ scaled @ found + (slope / size) @ found)
