"""Models of growing size fitted to the same logs, and the error of each on held-out logs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from exodrake.diagnosis.closure import change_robot
from exodrake.diagnosis.fit import Explanation, minimise
from exodrake.diagnosis.likelihood import Likelihood, output_error
from exodrake.diagnosis.linearise import nominal_jacobian, with_effects
from exodrake.diagnosis.parameter import effect_parameters, nominal_parameters
from exodrake.diagnosis.problem import Problem
from exodrake.model.robot import Robot

ROUNDS, STEPS = 4, 8  # of fitting, with a new Jacobian in each; steps within a round
TOL = 1e-3  # share of the cost that a step and a round must gain
STARTS = (1.0, -1.0, 0.3)  # times the initial value, from which a new effect is fitted


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A fitted model."""

    name: str
    robot: Robot
    held: tuple[np.ndarray, ...]  # residuals (n, columns) [SI] on each held-out log

    @property
    def rms(self) -> np.ndarray:
        """RMS over the held-out logs (columns,) [SI]."""
        return np.sqrt(np.nanmean(np.concatenate(self.held) ** 2, axis=0))


def growing_models(problem: Problem, steps: list[tuple[str, tuple[str, ...]]]) -> list[FittedModel]:
    """Fits models of growing size in closed loop: of each its name, and the effects that it adds to the one before."""
    likelihood, nominal = output_error(problem), nominal_parameters(problem.robot)
    values, x = problem.silent(), np.zeros(len(nominal))
    (residual,) = likelihood.residual(values[None])
    point = Explanation((), nominal, x, values, residual, np.zeros((len(nominal), 0)))
    point = replace(point, jacobian=nominal_jacobian(likelihood, point))
    found = []
    for name, effects in steps:
        for identity in effects:
            point = extended(likelihood, point, identity)
        robot = replace(change_robot(problem, point.robot, f"fit of {name}"), source=f"fitted: {name}")
        held = tuple(t.measured - problem.predict(point.robot[None], t)[0] for t in problem.judged)
        found.append(FittedModel(name, robot, held))
    return found


def extended(likelihood: Likelihood, point: Explanation, identity: str) -> Explanation:
    """The best fit with one more effect, from several starts."""
    machine = likelihood.robot.machine
    effect = machine.effect(identity)
    extra = effect_parameters(likelihood.robot, effect)
    values, parameters = with_effects(point.values, machine, [effect]), (*point.parameters, *extra)
    joined = replace(point, effects=(*point.effects, identity), parameters=parameters, values=values)
    low, high = np.array([p.bounds for p in parameters]).T
    fits = []
    for factor in STARTS:
        own = [factor * p.start if p.amplitude else p.start for p in extra]
        start = joined.at(likelihood, np.clip(np.concatenate([point.x, own]), low, high))
        fits.append(converged(likelihood, start))
    return min(fits, key=lambda e: e.cost(likelihood))


def converged(likelihood: Likelihood, point: Explanation) -> Explanation:
    """A fit with new Jacobians of the nominal parameters until it gains no more."""
    for _ in range(ROUNDS):
        point = replace(point, jacobian=nominal_jacobian(likelihood, point), columns=None)
        better = minimise(likelihood, point, STEPS, TOL)
        if better.cost(likelihood) > (1.0 - TOL) * point.cost(likelihood):
            return better
        point = better
    return point


def predicted(problem: Problem, robot: Robot, trials) -> tuple[np.ndarray, ...]:
    """Logs (n, columns) [SI] that a robot would have written, noise-free and unrounded."""
    values = problem.silent(robot)
    return tuple(problem.predict(values[None], t)[0] for t in trials)
