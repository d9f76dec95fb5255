"""Maximum a posteriori fit of a hypothesis together with the small errors of the nominal numbers.

    cost = 1/2 |r|^2 + frames/2 |x / spread|^2          r = (measured - simulated) / noise standard deviation

frames: how many of the log count as one (`MEMORY`). No model is exact, and what it leaves, small as it is, repeats
itself; with every frame counted, the data drag the nominal numbers far from where they usually are, the parameters of
an effect with them, and effects that are there hide in numbers that are not (a tempered likelihood; Bissiri, Holmes and
Walker 2016).

It is found by Levenberg-Marquardt. The response to the coordinates of the nominal numbers changes little, so it is
computed once at a point and shared; each step then corrects it along the way it went (Broyden 1965), so that a fit
goes on converging.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.diagnosis import nuisance
from exodrake.diagnosis.hypothesis import Hypothesis
from exodrake.diagnosis.problem import Problem

# s of a log that count as one frame. 90 % intervals of the nominal numbers of 24 healthy development robots (seed
# 411021, linear about their fits) covered 90 % with these 33 frames as one; 41 % with every frame, and errors a third
# larger. `exodrake.blind.calibrate` measures it anew
MEMORY, SHORTEST = 0.66, 0.02  # and no shorter frames: of faster logs, none was calibrated
NUDGE = 1e-2  # step of a difference quotient in units of a coordinate's scale
NUDGE_NUMBER = 5e-3  # of a nominal number, relative [-] or [rad]
DAMPING = 1e-8  # of the curvature, at first: the prior of the nominal numbers bounds the valleys
SMALLEST_MOVE = (
    1e-6  # of the nominal coordinates, squared and in units of their spread, from which a response can be corrected
)
GAIN_ENOUGH = 5e-4  # a fit ends when a step lowers the cost by less than this fraction
POLISH, STILL = 8, 1e-6  # steps of the last fit, and the fraction of the cost by which it must go on falling
NEARLY = 1e-4  # that fraction where only candidates are told apart
ROUNDS, ENDING = 4, 0.01  # responses are taken anew so often at most, and while that gains this fraction of the cost


@dataclass(frozen=True, eq=False)
class Point:
    """Where a fit stands: u (effect coordinates), x (nominal coordinates), residual (samples,) and cost."""

    hypothesis: Hypothesis
    u: np.ndarray
    x: np.ndarray
    residual: np.ndarray
    cost: float

    @property
    def chi2(self) -> float:
        """Mean square of the residual [noise variance]."""
        return float(np.mean(self.residual**2))


def as_one(problem: Problem, memory: float = MEMORY) -> float:
    """How many frames count as one."""
    return max(1.0, memory / max(problem.robot.machine.frame, SHORTEST))


class Fitter:
    """Fits hypotheses to a problem, `memory` [s] of a log counting as one frame; `spread` is that of the nominal
    coordinates beside a cost in which every frame counts.
    """

    def __init__(self, problem: Problem, memory: float = MEMORY) -> None:
        self.problem, self.frames = problem, as_one(problem, memory)
        self.coordinates = nuisance.coordinates(problem.robot.machine)
        self.spread = np.array([k.prior_std for k in self.coordinates]) / np.sqrt(self.frames)
        self.limit = np.array([k.max_deviation for k in self.coordinates])
        self.silent = problem.silent()

    def values(self, hypothesis: Hypothesis, u: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Flat numbers of the robot at a point."""
        return hypothesis.apply(nuisance.turned(self.silent, self.coordinates, x), u)

    def at(self, hypothesis: Hypothesis, u: np.ndarray, x: np.ndarray) -> Point:
        """The point with its residual and cost."""
        residual = self.problem.residual(self.values(hypothesis, u, x)[None], self.problem.fit)[0]
        return self.scored(hypothesis, u, x, residual)

    def scored(self, hypothesis: Hypothesis, u: np.ndarray, x: np.ndarray, residual: np.ndarray) -> Point:
        """A point whose residual is known."""
        return Point(
            hypothesis, u, x, residual, 0.5 * float(residual @ residual) + 0.5 * float(np.sum((x / self.spread) ** 2))
        )

    def responses(self, point: Point, central: bool = False) -> np.ndarray:
        """d residual / d x at a point, (samples, nominal coordinates); `central`: from both sides."""
        rows = [
            self.values(point.hypothesis, point.u, point.x + NUDGE_NUMBER * row)
            for row in np.eye(len(self.coordinates))
        ]
        moved = self.problem.residual(np.array(rows), self.problem.fit)
        if not central:
            return ((moved - point.residual) / NUDGE_NUMBER).T
        rows = [
            self.values(point.hypothesis, point.u, point.x - NUDGE_NUMBER * row)
            for row in np.eye(len(self.coordinates))
        ]
        moved -= self.problem.residual(np.array(rows), self.problem.fit)
        return (moved / (2.0 * NUDGE_NUMBER)).T

    def slopes(self, point: Point, central: bool = False) -> np.ndarray:
        """d residual / d u at a point, (samples, effect coordinates): one-sided and away from a bound, or `central`
        where there is room on both sides.
        """
        steps, (low, high) = NUDGE * point.hypothesis.scales, point.hypothesis.bounds.T
        steps = np.where(point.u + steps > high, -steps, steps)
        if not len(steps):
            return np.zeros((len(point.residual), 0))
        there = self.turned(point, steps)
        if not central:
            return ((there - point.residual) / steps[:, None]).T
        back = np.where((point.u - steps < low) | (point.u - steps > high), 0.0, -steps)
        return ((there - self.turned(point, back)) / (steps - back)[:, None]).T

    def turned(self, point: Point, steps: np.ndarray) -> np.ndarray:
        """Residuals (effect coordinates, samples) with each coordinate of the effect moved by its step alone."""
        rows = [self.values(point.hypothesis, point.u + move, point.x) for move in np.diag(steps)]
        return self.problem.residual(np.array(rows), self.problem.fit)

    def fit(
        self,
        start: Point,
        responses: np.ndarray,
        steps: int = 8,
        gram: np.ndarray | None = None,
        enough: float = GAIN_ENOUGH,
        central: bool = False,
    ) -> Point:
        """Levenberg-Marquardt from a point; `responses` (samples, nominal coordinates) of a point nearby; it ends
        when a step lowers the cost by less than the fraction `enough`; `central`: slopes from both sides.
        """
        point, damping = start, DAMPING
        gram = responses.T @ responses if gram is None else gram
        for _ in range(steps):
            slopes = self.slopes(point, central)
            better = None
            for _ in range(4):
                u, x = self.step(point, slopes, responses, gram, damping)
                trial = self.at(point.hypothesis, u, x)
                responses, gram = self.corrected(responses, gram, slopes, point, trial)
                if trial.cost < point.cost:
                    better = trial
                    break
                damping = max(100.0 * damping, 1e-5)
            if better is None:
                return point
            gain, point, damping = 1.0 - better.cost / point.cost, better, max(0.1 * damping, DAMPING)
            if gain < enough:
                return point
        return point

    def minimised(self, point: Point, central: bool = True) -> tuple[Point, np.ndarray]:
        """A point fitted until the cost stands still, with the responses that it took: along a flat valley between an
        effect and nominal numbers, where a race stops early, only the small errors that these usually have tell where
        the truth lies. `central`: slopes from both sides; the curvature in one-sided ones passes for information along
        the valley, which does for telling candidates apart, at half the price, but not for stating their parameters.
        """
        enough = STILL if central else NEARLY
        for _ in range(ROUNDS):
            responses, before = self.responses(point, central), point.cost
            point = self.fit(point, responses, POLISH, enough=enough, central=central)
            if before - point.cost < ENDING * point.cost:
                break
        return point, responses

    def nuisance_chi2(self, point: Point) -> float:
        """How far the nominal numbers are from where they usually are: mean square in units of their spread."""
        return float(np.mean((point.x / self.spread) ** 2)) / self.frames

    def leap(self, point: Point, responses: np.ndarray, coordinate: int, value: float) -> tuple[float, np.ndarray]:
        """A nominal coordinate set to `value`, the other coordinates following by their responses.

        Returns the cost that these promise, and the nominal coordinates from which a fit may go on.
        """
        x = point.x.copy()
        x[coordinate] = value
        moved = self.at(point.hypothesis, point.u, x)
        others = np.arange(len(x)) != coordinate
        rest, prior = responses[:, others], 1.0 / self.spread[others] ** 2
        normal = rest.T @ rest + np.diag(prior)
        descent = -(rest.T @ moved.residual + prior * x[others])
        move = bounded_solve(normal, descent, -self.limit[others] - x[others], self.limit[others] - x[others])
        x[others] += move
        return moved.cost - float(descent @ move) + 0.5 * float(move @ normal @ move), x

    def corrected(
        self, responses: np.ndarray, gram: np.ndarray, slopes: np.ndarray, point: Point, trial: Point
    ) -> tuple[np.ndarray, np.ndarray]:
        """Responses to the nominal coordinates, and their Gram matrix, after Broyden's update with the step from
        `point` to `trial`.

        The effect's coordinates get their part of the step's error, too, but their slopes are taken anew at each step.
        """
        aside, move = trial.u - point.u, trial.x - point.x
        weight = move / self.spread**2
        size = float(weight @ move) + float(np.sum((aside / point.hypothesis.scales) ** 2))
        if size < SMALLEST_MOVE:
            return responses, gram
        error = trial.residual - point.residual - slopes @ aside - responses @ move
        weight /= size
        cross = np.outer(responses.T @ error, weight)
        return responses + np.outer(error, weight), gram + cross + cross.T + float(error @ error) * np.outer(
            weight, weight
        )

    def step(
        self, point: Point, slopes: np.ndarray, responses: np.ndarray, gram: np.ndarray, damping: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """u and x after one damped Gauss-Newton step within bounds."""
        scales, prior = point.hypothesis.scales, 1.0 / self.spread**2
        scaled = slopes * scales
        count = len(scales)
        normal = np.empty((count + len(self.coordinates),) * 2)
        normal[:count, :count] = scaled.T @ scaled
        normal[:count, count:] = scaled.T @ responses
        normal[count:, :count] = normal[:count, count:].T
        normal[count:, count:] = gram + np.diag(prior)
        descent = -np.concatenate([scaled.T @ point.residual, responses.T @ point.residual + prior * point.x])
        low, high = point.hypothesis.bounds.T if count else (np.zeros(0), np.zeros(0))
        bounds = (
            np.concatenate([(low - point.u) / scales, -self.limit - point.x]),
            np.concatenate([(high - point.u) / scales, self.limit - point.x]),
        )
        move = bounded_solve(normal + damping * np.diag(np.diag(normal) + 1e-12), descent, *bounds)
        return point.u + scales * move[:count], point.x + move[count:]


def bounded_solve(normal: np.ndarray, descent: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Minimum of 1/2 m'N m - d'm within bounds, by the active-set method for bounded least squares."""
    from scipy.linalg import cho_factor, solve_triangular
    from scipy.optimize import lsq_linear

    size = np.sqrt(np.diag(normal))
    scaled = normal / np.outer(size, size) + 1e-12 * np.eye(len(size))
    factor = np.triu(cho_factor(scaled)[0])
    target = solve_triangular(factor, descent / size, trans=1)
    free = solve_triangular(factor, target) / size
    if np.all((free >= low) & (free <= high)):
        return free
    high = np.maximum(high, low + 1e-12)
    return np.clip(lsq_linear(factor, target, (low * size, high * size), method="bvls").x / size, low, high)
