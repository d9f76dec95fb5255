"""Models of growing size fitted to the same logs, and the error of each on held-out logs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.core.robot import Robot
from exodrake.diagnosis.fit import Fitter, Point
from exodrake.diagnosis.hypothesis import NOTHING, Hypothesis, hypothesis
from exodrake.diagnosis.problem import Problem

ROUNDS, STEPS = 4, 8  # of fitting, with a new Jacobian in each; steps within a round
STARTS = (1.0, -1.0, 0.3)  # times the initial value, from which a new effect is fitted


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A fitted model.

    Attributes:
        name: of the model.
        robot: fitted.
        held: residuals (n, columns) [SI] on each held-out log.
    """

    name: str
    robot: Robot
    held: tuple[np.ndarray, ...]

    @property
    def rms(self) -> np.ndarray:
        """RMS over the held-out logs (columns,) [SI]."""
        return np.sqrt(np.nanmean(np.concatenate(self.held) ** 2, axis=0))


def growing_models(
    problem: Problem, steps: list[tuple[str, tuple[str, ...]]], retune: bool = True
) -> list[FittedModel]:
    """Fits models of growing size.

    Args:
        problem: logs to fit and to hold out.
        steps: name of each model, and the effects that it adds to the one before.
        retune: whether the nominal parameters are fitted, too.
    """
    fitter = Fitter(problem)
    if not retune:
        fitter.limit = np.full_like(fitter.limit, 1e-12)
    point = fitter.at(NOTHING, np.zeros(0), np.zeros(len(fitter.coordinates)))
    found = []
    for name, effects in steps:
        for identity in effects:
            machine = problem.robot.machine
            point = extended(fitter, point, hypothesis(machine, machine.effect(identity)))
        found.append(model(problem, fitter, point, name))
    return found


def extended(fitter: Fitter, point: Point, extra: Hypothesis) -> Point:
    """The best fit with one more effect, from several starts."""
    both = point.hypothesis.joined(extra)
    first = np.array([coordinate.first for coordinate in extra.coordinates])
    best = None
    for factor in STARTS:
        u = np.where(first, factor * extra.start, extra.start)
        start = fitter.at(both, np.clip(np.concatenate([point.u, u]), *both.bounds.T), point.x)
        fitted = converged(fitter, start)
        best = fitted if best is None or fitted.cost < best.cost else best
    assert best is not None
    return best


def converged(fitter: Fitter, point: Point) -> Point:
    """A fit with new Jacobians of the nominal parameters until it gains no more."""
    for _ in range(ROUNDS):
        better = fitter.fit(point, fitter.responses(point), steps=STEPS)
        if better.cost > 0.999 * point.cost:
            return better
        point = better
    return point


def model(problem: Problem, fitter: Fitter, point: Point, name: str) -> FittedModel:
    """A fitted point with its robot and held-out residuals."""
    values = fitter.values(point.hypothesis, point.u, point.x)
    noisy = [problem.robot.machine.index[n] for n in (*problem.robot.machine.noise, *problem.robot.machine.resolution)]
    kept = values.copy()
    kept[noisy] = problem.robot.values[noisy]
    nominal = problem.robot
    fitted = {
        e.name: "fitted" for e, a, b in zip(nominal.machine.parameters, kept, nominal.values, strict=True) if a != b
    }
    robot = Robot(nominal.machine, kept, {**nominal.sources, **fitted}, nominal.ranges, source=f"fitted: {name}")
    held = tuple(t.measured - problem.predict(values[None], t)[0] for t in problem.holdout)
    return FittedModel(name, robot, held)


def predicted(problem: Problem, robot: Robot, trials) -> tuple[np.ndarray, ...]:
    """Logs (n, columns) [SI] that a robot would have written, noise-free and unrounded."""
    values = problem.silent(robot)
    return tuple(problem.predict(values[None], t)[0] for t in trials)
