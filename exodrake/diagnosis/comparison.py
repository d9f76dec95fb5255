"""Comparison of two explanations: reduction of the cost, complexity of their laws, and use of the tolerances."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from exodrake.core.machine import Machine
from exodrake.core.once import once
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.linearise import without_effect, without_shape
from exodrake.diagnosis.refine import Explanation


@dataclass(frozen=True)
class Compared:
    """Comparison of one explanation with its rivals, over a case or one joint; fields as in `Levels`."""

    complete: float
    promise: float
    next_effect: str
    beaten_by: str
    no_better: frozenset[str]
    share: float


@dataclass(frozen=True)
class Reduction:
    """Reduction of the cost when a rival replaces an explanation.

    Attributes:
        power: weighted sum of squares by which the residual falls [-].
        share: of the excess over noise, the use of the priors included [-]; 0 where there is no excess.
    """

    power: float
    share: float


def power(rows: np.ndarray) -> np.ndarray:
    """Sum of squares of rows (..., samples)."""
    return np.einsum("...i,...i->...", rows, rows, dtype=float)


def taken_up(likelihood: Likelihood, e: Explanation, rival: Explanation, levels: np.ndarray | float = 1.0) -> Reduction:
    """The cost that a rival takes up of what an explanation leaves; negative where it leaves more.

    levels: reduced chi-squares (views,) of noise alone.
    """
    likelihood = likelihood.scaled_to(e.residual)
    less, whole = 2.0 * (e.cost(likelihood) - rival.cost(likelihood)), excess(likelihood, e, levels)
    residual = power(e.residual * likelihood.weights) - power(rival.residual * likelihood.weights)
    return Reduction(float(residual), share_of(less, whole))


def share_of(less: float, whole: float) -> float:
    """Share of an excess over noise by which a cost falls; 0 where there is no excess."""
    return less / whole if whole > 0.0 else 0.0


def excess(likelihood: Likelihood, e: Explanation, levels: np.ndarray | float = 1.0) -> float:
    """Weighted sum of squares that an explanation leaves, the use of its priors included, above that of noise.

    A view that leaves less than noise, as where sensors are quieter than the robot file says, has no excess, and makes
    up for none. Where many samples count as one, a true explanation uses its priors for more than noise does: its
    excess is then about as large as the number of parameters that the logs determine. `levels` as in `taken_up`.
    """
    noise = np.array([power(part) for part in likelihood.split(likelihood.weights)]) * levels
    left = np.array([power(part) for part in likelihood.split(e.residual * likelihood.weights)])
    return float(np.sum(np.maximum(left - noise, 0.0)) + power(e.use))


def removed(before: np.ndarray, after: np.ndarray) -> float:
    """Share of the excess over noise that is gone, from reduced chi-squares (views,), all views together."""
    left, gap = (float(np.maximum(chi2 - 1.0, 0.0).sum()) for chi2 in (after, before))
    return 1.0 - left / gap if gap > 0.0 else 0.0


def other_law(likelihood: Likelihood, e: Explanation, other: Explanation) -> bool:
    """Whether two explanations hold different laws of the same effects."""
    machine = likelihood.robot.machine
    kinds = [sorted((machine.effect(i).block, machine.effect(i).family) for i in x.effects) for x in (e, other)]
    return kinds[0] == kinds[1] and e.effects != other.effects


def richer_law(likelihood: Likelihood, richer: Explanation, simpler: Explanation) -> bool:
    """Whether an explanation holds another law of the same effects, with more parameters."""
    return len(richer.x) > len(simpler.x) and other_law(likelihood, richer, simpler)


def contributions(
    machine: Machine, e: Explanation, simulate: Callable[[np.ndarray], np.ndarray], whole: np.ndarray
) -> dict[str, np.ndarray]:
    """Contribution (channels, ...) of each effect of an explanation: by how much outputs differ without it.

    Args:
        machine: of the robots.
        e: explanation.
        simulate: outputs (robots, ...) of flat parameter vectors (robots, n).
        whole: (...) outputs of the explanation itself.
    """
    return {i: simulate(without_effect(machine, e.robot, machine.effect(i))) - whole for i in e.effects}


def residual_contributions(likelihood: Likelihood, e: Explanation) -> dict[str, np.ndarray]:
    """Contribution (channels, samples) of each effect of an explanation to its residual, simulated once."""
    machine = likelihood.robot.machine
    return once(e, "contributions", lambda: contributions(machine, e, likelihood.residual, e.residual))


def shape_contributions(likelihood: Likelihood, e: Explanation) -> dict[str, np.ndarray]:
    """Contribution (samples,) of what shapes the law of each effect whose amplitude means the same in every law.

    Effects without such parameters are left out; simulated once.
    """

    def simulated() -> dict[str, np.ndarray]:
        machine = likelihood.robot.machine
        effects = [effect for effect in map(machine.effect, e.effects) if effect.same_meaning and effect.shapes]
        rows = {effect.id: without_shape(machine, e.robot, effect) for effect in effects}
        return {i: likelihood.residual(row[None])[0] - e.residual for i, row in rows.items()}

    return once(e, "shapes", simulated)


def amplitude(left: np.ndarray, noise: np.ndarray, law: np.ndarray) -> np.ndarray:
    """Amplitude (draws,) of the error of the laws, in units of rho, with which noise leaves as much as is left."""
    return np.sqrt(np.maximum(left - noise, 0.0) / np.maximum(law, 1e-9)).astype(np.float32)
