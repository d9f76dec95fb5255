"""Rival explanations, linearised on the logs of a case.

Each has a Jacobian J of its whitened residuals and the precision P of its tolerances. After the logs the covariance of
its parameters is

    (J'J / n + P)^-1 = V V'        n: frames that count as one (`likelihood.CORRELATION`), times what is left of noise
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.errors import InputError
from exodrake.diagnosis.calibration import calibration_of
from exodrake.diagnosis.comparison import contributions, power, richer_law
from exodrake.diagnosis.detect import detect
from exodrake.diagnosis.likelihood import CORRELATION, Likelihood, likelihood_of
from exodrake.diagnosis.linearise import Linearisation, nominal_jacobian, with_effects
from exodrake.diagnosis.parameter import Parameter, effect_parameters, nominal_parameters
from exodrake.diagnosis.part_used import SHARE
from exodrake.diagnosis.problem import Problem, Trial
from exodrake.diagnosis.projection import Projection, normal_matrix
from exodrake.diagnosis.refine import Explanation, whole_jacobian
from exodrake.diagnosis.rival import Rival

SMALL = 1e-9  # above 0, for a division


@dataclass(frozen=True, eq=False)
class Laws:
    """Errors of the laws of explanations, as the logs show them.

    Attributes:
        granted: (explanations,) G, sum of squares of what a diagnosis grants the laws of each to be wrong by: rho times
            what effects contribute and no other parameter imitates, in frames that count as one [noise_std^2].
        own: (explanations,) share of rho times what they contribute that no other parameter imitates.
        error: (explanations,) a, error of the laws of each with which it leaves what it leaves, in units of rho.
        share: q, that a true explanation takes up of what a wrong one leaves.
        richer: (explanations, explanations) whether the first one is a richer law of the effects of the second.
    """

    granted: np.ndarray
    own: np.ndarray
    error: np.ndarray
    share: float
    richer: np.ndarray


@dataclass(frozen=True, eq=False)
class Contest:
    """A case and the explanations still in play.

    Attributes:
        problem: the case in full length.
        likelihood: its closed-loop view alone, of the part of the logs that a diagnosis uses.
        explanations: fitted; their residuals and Jacobians are those of that part.
        spreads: (parameters, directions) V of each.
        laws: what the logs show of their laws.
    """

    problem: Problem
    likelihood: Likelihood
    explanations: tuple[Explanation, ...]
    spreads: tuple[np.ndarray, ...]
    laws: Laws

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the explanations."""
        return tuple(e.name for e in self.explanations)

    @property
    def robots(self) -> np.ndarray:
        """Flat parameter vectors (explanations, parameters) [SI]."""
        return np.array([e.robot for e in self.explanations])

    def records(self, reference: Reference) -> np.ndarray:
        """All signals (explanations, frames, signals) [SI] of the runs of the explanations on a reference."""
        return self.problem.records(self.robots, Trial(reference.name, "fit", reference.values, np.zeros((0, 0))))

    def difference(self, records: np.ndarray) -> float:
        """Difference in the logged columns between the two most similar runs of `records`, for a first ranking.

        The mean over frames of log(1 + d), d the mean square difference [noise_std^2]: a snap is a few frames.
        """
        logs = records[:, :, self.problem.signal_indices] / self.problem.noise_std
        return min(float(np.mean(np.log1p(np.mean((a - b) ** 2, axis=1)))) for a, b in combinations(logs, 2))


def contest_of(problem: Problem, rivals: Sequence[Rival]) -> Contest:
    """The contest of a case.

    Args:
        problem: the case.
        rivals: two or more explanations with their fitted parameters.

    Raises:
        InputError: for a rival with an effect or a parameter that the machine does not have.
    """
    machine, nominal = problem.robot.machine, problem.silent()
    rows = np.array([fitted_values(problem, nominal, rival) for rival in rivals])
    problem = detect(problem, rows[0])
    likelihood = likelihood_of(problem.shortened(SHARE), rows[0])
    likelihood = Likelihood(likelihood.views[:1])
    found = []
    for rival, row in zip(rivals, rows, strict=True):
        effects = [machine.effect(identity) for identity in rival.effects]
        parameters = nominal_parameters(problem.robot)
        count = len(parameters)
        for effect in effects:
            parameters += effect_parameters(machine, effect)
        x = np.array([coordinate(p, row, nominal) for p in parameters])
        values = with_effects(problem.silent(), [(machine, effect) for effect in effects])
        residual = likelihood.residual(row[None])[0]
        e = Explanation(rival.effects, parameters, x, values, residual, np.zeros((count, len(residual))))
        jacobian = nominal_jacobian(likelihood, e.at_nominal, parameters[:count], x[:count], residual)
        found.append(replace(e, jacobian=jacobian))
    spreads = tuple(spread(likelihood, e) for e in found)
    return Contest(problem, likelihood, tuple(found), spreads, laws_of(likelihood, found))


def laws_of(likelihood: Likelihood, found: Sequence[Explanation]) -> Laws:
    """Errors of the laws of fitted explanations, from the logs."""
    machine, frames = likelihood.robot.machine, effective(likelihood)
    limits, rows = calibration_of(machine), []
    for e in found:
        nothing = Linearisation(e.parameters, e.x, e.residual, e.jacobian, np.zeros((0, len(e.residual))), ())
        project = Projection(likelihood.scaled_to(e.residual), e, nothing)
        changes = contributed(likelihood, e, e.residual)
        own = [project.own(row, effect) for effect, rows in changes.items() for row in rows]
        whole, size = (sum(float(power(np.asarray(rows)).sum()) for rows in some) for some in ([own], changes.values()))
        left = max(float(power(e.residual)) - len(e.residual), 0.0) / frames + float(np.sum(e.use[: e.nominal] ** 2))
        rows.append((max(whole, SMALL) / frames, whole / max(size, SMALL), left))
    squares, own, left = np.array(rows).T
    least = limits.same_meaning / limits.law_error
    richer = np.array([[richer_law(likelihood, a, b) for b in found] for a in found])
    return Laws(squares, own, np.clip(np.sqrt(left / squares), least, None), limits.taken, richer)


def effective(likelihood: Likelihood) -> float:
    """Number of frames that count as one sample (autocorrelation)."""
    return max(CORRELATION / likelihood.robot.machine.frame, 1.0)


def contributed(likelihood: Likelihood, e: Explanation, residual: np.ndarray) -> dict[str, np.ndarray]:
    """Contribution of each channel of each effect to a residual, times its rho: effect -> (channels, samples)."""
    return granted(likelihood.views[0].problem, e, likelihood.residual, residual)


def granted(
    problem: Problem, e: Explanation, simulate: Callable[[np.ndarray], np.ndarray], whole: np.ndarray
) -> dict[str, np.ndarray]:
    """Contribution (channels, ...) of each effect times its rho, the error that its law is granted (`Calibration.rho`).

    simulate, whole: as in `contributions`, in whose unit the errors are.
    """
    machine = problem.robot.machine
    limits, found = calibration_of(machine), contributions(machine, e, simulate, whole)
    return {i: limits.rho(machine.effect(i), problem.counted) * rows for i, rows in found.items()}


def fitted_values(problem: Problem, nominal: np.ndarray, rival: Rival) -> np.ndarray:
    """Flat parameter vector (parameters,) [SI] of a rival."""
    machine, values = problem.robot.machine, nominal.copy()
    for identity in rival.effects:
        machine.effect(identity)
    for name, value in rival.parameters.items():
        if name not in machine.index:
            raise InputError(f"{rival.name}: {machine.name} has no parameter {name!r}; answered with another robot?")
        values[machine.index[name]] = value
    return values


def coordinate(parameter: Parameter, values: np.ndarray, nominal: np.ndarray) -> float:
    """Coordinate of a parameter in flat vectors (parameters,) of a fitted and of the nominal robot."""
    base = parameter.base if parameter.effect else float(nominal[parameter.index[0]])
    return replace(parameter, base=base).coordinate(float(values[parameter.index[0]]))


def spread(likelihood: Likelihood, e: Explanation) -> np.ndarray:
    """V (parameters, parameters) with V V' the covariance that the logs leave to the parameters."""
    weights = likelihood.scaled_to(e.residual).weights
    normal = normal_matrix(whole_jacobian(likelihood, e) * weights, 1.0 / e.prior_std**2)
    return np.linalg.inv(np.linalg.cholesky(normal)).T
